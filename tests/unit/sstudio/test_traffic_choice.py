from smarts.errors import ScenarioError
from smarts.sstudio.build import build_scenario
from tests.raising import raises


def test_only_the_chosen_traffic_is_played():
    built = build_scenario("intersection")
    assert {plan.traffic for plan in built.episodes(4)} == {"no_social_vehicles", "random_social_vehicles"}
    chosen = built.with_traffic(["random_social_vehicles"])
    assert [plan.traffic for plan in chosen.episodes(4)] == ["random_social_vehicles"]
    assert chosen.traffic_files("no_social_vehicles")  # still there for who asks for it


def test_unknown_traffic_is_refused_with_the_nearest_name():
    with raises(ScenarioError, values=["no_social_vehicles"]):
        build_scenario("intersection").with_traffic(["no_social_vehicle"])
