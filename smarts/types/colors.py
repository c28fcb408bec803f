"""Named colours of scenes and charts, red, green, blue and opacity in [0, 1]."""

from __future__ import annotations

from enum import Enum

Rgba = tuple[float, float, float, float]


def _rgb(red: int, green: int, blue: int, opacity: float = 1) -> Rgba:
    """Return a colour from channels in 0..255."""
    return red / 255, green / 255, blue / 255, opacity


class Colors(Enum):
    """Colours by name."""

    Red = _rgb(210, 30, 30)
    Rose = _rgb(196, 0, 84)
    Maroon = _rgb(128, 0, 0)
    Orange = _rgb(237, 109, 0)
    Yellow = _rgb(255, 190, 40)
    GreenTransparent = _rgb(98, 178, 48, 0.3)
    Silver = _rgb(192, 192, 192)
    Black = _rgb(0, 0, 0)
    Green = _rgb(30, 210, 30)
    DarkBlue = _rgb(5, 5, 70)
    Blue = _rgb(0, 153, 255)
    LightBlue = _rgb(173, 216, 230)
    BlueTransparent = _rgb(60, 170, 200, 0.6)
    DarkCyan = _rgb(47, 79, 79)
    CyanTransparent = _rgb(48, 181, 197, 0.5)
    DarkPurple = _rgb(50, 30, 50)
    Purple = _rgb(127, 0, 127)
    DarkGrey = _rgb(80, 80, 80)
    Grey = _rgb(119, 136, 153)
    LightGreyTransparent = _rgb(221, 221, 221, 0.1)
    OffWhite = _rgb(200, 200, 200)
    White = _rgb(255, 255, 255)


class SceneColors(Enum):
    """What is drawn in which colour."""

    Agent = Colors.Red.value
    SocialAgent = Colors.Blue.value
    SocialVehicle = Colors.Silver.value
    Road = Colors.DarkGrey.value
    EgoWaypoint = Colors.CyanTransparent.value
    EgoDrivenPath = Colors.CyanTransparent.value
    BubbleLine = Colors.LightGreyTransparent.value
    MissionRoute = Colors.GreenTransparent.value
    LaneDivider = Colors.OffWhite.value
    EdgeDivider = Colors.Yellow.value
    SignalUnknown = Colors.Grey.value
    SignalStop = Colors.Maroon.value
    SignalCaution = Colors.Yellow.value
    SignalGo = Colors.Green.value
