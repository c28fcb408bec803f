"""What a browser gets: episodes and running simulations as sequences of binary messages.

A compact episode, as pages hold it, is the 8 bytes `SMARTSEP`, then messages, each behind its length (uint32,
little-endian, at most 8 MB). A message is a msgpack map with the key `type`; readers ignore types and keys
that they do not know. Arrays are as in `smarts.stream.arrays`. Texts are lists. A column of lists has `o`:
offsets of its rows, one more than rows.

- `episode`: `version` 1; `facts`: the row of the table `episode`, and `policy`, what drove the egos ("" if
  unknown); `names`: of enumerations, `{"Owner": {"0": ...}}`; `origin` [x, y], subtracted from positions in
  `map` and `steps` (m)
- `map`: `digest`; `bounds` [x0, y0, x1, y1] (m); `lanes`: `start` (rows of points, one more than lanes), `x`,
  `y` (cm, runs are lanes; less than 2 cm off), `width` (cm), `kind` LaneKind, `junction`, `left` and `right`
  the line painted there (0 none, 1 dashed white, 2 solid white, 3 solid yellow towards the other direction),
  `stop` (line at its end: 1 at lights, 2 gives way), `signal` (has a light), `speed_limit` (m/s), `edge`;
  `edges`: ids
- `table`: `name`, `columns`, `append`: false replaces. Names and columns of recorded episodes
  (`smarts.types.episode_schema`); rows of an agent have `agent`, its row in `agents`, too. Positions are in
  the map's frame (m). First agents, holds, routes, bubbles, bubble_rings; then, before the steps that they
  belong to, rows of agent_states, decisions, signals, extras, observations, transfers, bubble_poses,
  agent_failures, and `outcomes`: agent, step, outcome, partner_slot, partner_generation; live, `outcomes` is
  sent whole when an agent has ended
- `vehicles`: `number`, the stream's short name of (`slot`, `generation`); `name`, `kind`, `length`, `width`
- `steps`: K steps: `step` (K,); of each run, a vehicle that is there without a gap: `number`, `begin` (index
  into `step`), `count`; of each row, run by run: `x`, `y` (cm), `heading` (0.1 degree counter-clockwise from
  +x), `speed` (cm/s), `steer` (0.1 degree, 0 where unknown), `flags`: bits 0 to 2 Owner, 3 brake light, 4 and
  5 left and right indicator, 6 in an air-lock, 7 waits to go back to traffic, 8 has collided. A message of
  one step has neither `begin` nor `count`; its columns may be runs of one row. Each message can be read
  without those before it
- `end`: `is_complete`, `remark`

Live, a WebSocket frame (`/live`) is one message, and all but `sources` have `source` and `serial`, which
counts the episodes of that source. A viewer sends `{"watch": [id, ...], "observe": {id: agent}}`, at most 9
ids and 4 kB; `observe` may be left out.

Rows of `observations` have `step`, `agent`, `name` and the list `values`: `waypoints` x, y in turn (m,
relative to `origin`), paths parted by two NaN; `neighbors` x, y, heading, length, width, speed of each;
`lidar` x, y of each point; `grid:NAME` height, width, m of a cell, then cells from 0 to 1, row by row from
ahead to behind, each from left to right; `rgb:NAME` likewise with three values a cell. Of `extras`,
`probabilities`, or `mean` and `std` tell how an action was drawn; `reward` and `reward/TERM` are drawn over
time.
"""
