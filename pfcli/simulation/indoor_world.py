"""Indoor worlds as wall segments: floor plans with rooms, doors, corridors and furniture, made from a few numbers."""

import functools
import itertools
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from pfcli.core.grid.grid_map import GridMap
from pfcli.events import Pose2


class World(NamedTuple):
    """walls: (s, 4) segments x1, y1, x2, y2 (m); route: (k, 2) way points (m), NaN where the robot is carried to the next;
    unmapped: (u, 4) segments that stand there, but in no map."""

    walls: NDArray[np.float64]
    route: NDArray[np.float64]
    unmapped: NDArray[np.float64] = np.empty((0, 4))


_ROOM_TO_PASS_M = 0.5
"""Half of what a robot and its turning circle take."""


class _Plan:
    def __init__(self, rng: np.random.Generator) -> None:
        self.segments: list[tuple[float, float, float, float]] = []
        self.rng = rng

    def wall(
        self, x1: float, y1: float, x2: float, y2: float, doors: tuple[float, ...] = (), width: float = 1.0
    ) -> None:
        """A wall with gaps of `width` centred at these distances from its start."""
        length = math.hypot(x2 - x1, y2 - y1)
        ux, uy = (x2 - x1) / length, (y2 - y1) / length
        at = 0.0
        for door in [*sorted(doors), math.inf]:
            stop = min(length, door - width / 2)
            if stop > at:
                self.segments.append((x1 + ux * at, y1 + uy * at, x1 + ux * stop, y1 + uy * stop))
            at = door + width / 2
            if at >= length:
                break

    def box(self, x: float, y: float, w: float, h: float, yaw: float = 0.0) -> None:
        """A piece of furniture."""
        c, s = math.cos(yaw), math.sin(yaw)
        corners = [(x + c * a - s * b, y + s * a + c * b) for a, b in ((-w, -h), (w, -h), (w, h), (-w, h))]
        for (x1, y1), (x2, y2) in zip(corners, corners[1:] + corners[:1], strict=True):
            self.segments.append((x1, y1, x2, y2))

    def furnish(
        self,
        x0: float,
        y0: float,
        x1: float,
        y1: float,
        pieces: int,
        way: tuple[float, float, float, float] | None = None,
    ) -> None:
        """Boxes along the walls of a room, none where a robot drives along `way` (x1, y1, x2, y2; axis-parallel)."""
        while pieces:
            w, h = self.rng.uniform(0.2, 0.5, 2)
            side = int(self.rng.integers(4))
            px, py = self.rng.uniform(x0 + 0.8, x1 - 0.8), self.rng.uniform(y0 + 0.8, y1 - 0.8)
            px = x0 + w if side == 0 else x1 - w if side == 1 else px
            py = y0 + h if side == 2 else y1 - h if side == 3 else py
            if way:
                off_x = max(min(way[0], way[2]) - px - w, px - w - max(way[0], way[2]), 0.0)
                off_y = max(min(way[1], way[3]) - py - h, py - h - max(way[1], way[3]), 0.0)
                if math.hypot(off_x, off_y) < _ROOM_TO_PASS_M:
                    continue
            self.box(px, py, w, h)
            pieces -= 1

    def world(self, route: list[tuple[float, float]]) -> World:
        return World(np.round(np.array(self.segments), 3), np.array(route, float))


def ring(width: float, height: float, corridor: float, room: float, seed: int, laps: int = 1) -> World:
    """A building around a ring corridor with rooms on its outer side and a closed core.

    width, height: of the ring corridor's centre line (m); corridor: its width; room: depth of the rooms outside.
    The route drives the ring `laps` times and looks into a room on each side.
    """
    plan = _Plan(np.random.default_rng(seed))
    h, half = height, corridor / 2
    inner = (half, half, width - half, h - half)
    outer = (-half, -half, width + half, h + half)
    for x1, y1, x2, y2 in _edges(inner):
        plan.wall(x1, y1, x2, y2, _niches(plan, math.hypot(x2 - x1, y2 - y1)), 1.2)
    core = 1.0
    for x1, y1, x2, y2 in _edges((inner[0] + core, inner[1] + core, inner[2] - core, inner[3] - core)):
        plan.wall(x1, y1, x2, y2)
    if room > 0:
        _rooms(plan, outer, room)
    else:
        for x1, y1, x2, y2 in _edges(outer):
            plan.wall(x1, y1, x2, y2, _niches(plan, math.hypot(x2 - x1, y2 - y1)), 0.8)
        for x1, y1, x2, y2 in _edges((outer[0] - 0.4, outer[1] - 0.4, outer[2] + 0.4, outer[3] + 0.4)):
            plan.wall(x1, y1, x2, y2)
    lap = [(0.0, 0.0), (width, 0.0), (width, h), (0.0, h)]
    return plan.world([*lap * laps, (0.0, 0.0), (min(4.0, width / 2), 0.0)])


def _edges(box: tuple[float, float, float, float]) -> list[tuple[float, float, float, float]]:
    x0, y0, x1, y1 = box
    return [(x0, y0, x1, y0), (x1, y0, x1, y1), (x1, y1, x0, y1), (x0, y1, x0, y0)]


def _niches(plan: _Plan, length: float) -> tuple[float, ...]:
    """Doorways at irregular distances, so that no two stretches of the corridor look alike."""
    found, at = [], float(plan.rng.uniform(1.5, 4.0))
    while at < length - 1.5:
        found.append(at)
        at += float(plan.rng.uniform(2.5, 7.0))
    return tuple(found)


def _rooms(plan: _Plan, outer: tuple[float, float, float, float], depth: float) -> None:
    x0, y0, x1, y1 = outer
    for (ax, ay, bx, by), (nx, ny) in zip(_edges(outer), ((0, -1), (1, 0), (0, 1), (-1, 0)), strict=True):
        length = math.hypot(bx - ax, by - ay)
        ux, uy = (bx - ax) / length, (by - ay) / length
        cuts, at = [0.0], float(plan.rng.uniform(3.5, 6.0))
        while at < length - 3.0:
            cuts.append(at)
            at += float(plan.rng.uniform(3.5, 7.0))
        cuts.append(length)
        doors = tuple(float(plan.rng.uniform(a + 1.0, b - 1.0)) for a, b in itertools.pairwise(cuts))
        plan.wall(ax, ay, bx, by, doors, 1.0)
        for cut in cuts:
            px, py = ax + ux * cut, ay + uy * cut
            plan.wall(px, py, px + nx * depth, py + ny * depth)
        for a, b in itertools.pairwise(cuts):
            corners = [(ax + ux * t + nx * d, ay + uy * t + ny * d) for t in (a, b) for d in (0.0, depth)]
            xs, ys = [c[0] for c in corners], [c[1] for c in corners]
            plan.furnish(min(xs), min(ys), max(xs), max(ys), int(plan.rng.integers(1, 4)))
    plan.wall(x0, y0 - depth, x1, y0 - depth)
    plan.wall(x1 + depth, y0, x1 + depth, y1)
    plan.wall(x1, y1 + depth, x0, y1 + depth)
    plan.wall(x0 - depth, y1, x0 - depth, y0)


def office(seed: int) -> World:
    """40 x 25 m: two rows of rooms along a corridor with a cross passage; the route visits rooms and comes back."""
    plan = _Plan(np.random.default_rng(seed))
    width, height, low, high = 40.0, 25.0, 11.0, 13.5
    for x1, y1, x2, y2 in _edges((0.0, 0.0, width, height)):
        plan.wall(x1, y1, x2, y2)
    cuts_low, cuts_high = [0.0, 7.0, 13.0, 21.0, 28.5, 34.0, 40.0], [0.0, 5.5, 12.5, 19.0, 27.0, 33.0, 40.0]
    rooms = []
    for y, cuts, (y0, y1) in ((low, cuts_low, (0.0, low)), (high, cuts_high, (high, height))):
        centres = [(a + b) / 2 for a, b in itertools.pairwise(cuts)]
        doors = [c + float(plan.rng.uniform(-1.0, 1.0)) for c in centres]
        plan.wall(0.0, y, width, y, tuple(doors), 1.1)
        for cut in cuts[1:-1]:
            plan.wall(cut, y0, cut, y1)
        for a, b, door in zip(cuts, cuts[1:], doors, strict=False):
            inside = (y0 + y1) / 2
            plan.furnish(a, y0, b, y1, 5, (door, y, door, inside))
            rooms.append((door, inside, y))
    middle = (low + high) / 2
    route = [(1.5, middle)]
    for door, inside, _ in sorted(rooms[:6]):
        route += [(door, middle), (door, inside), (door, middle)]
    for door, inside, _ in sorted(rooms[6:], reverse=True):
        route += [(door, middle), (door, inside), (door, middle)]
    return plan.world([*route, (1.5, middle), (6.0, middle)])


_ALOFT = (math.nan, math.nan)
_EAST, _WEST = (21.0, 0.0), (3.0, 0.0)
_ROUND = [(24.0, 0.0), (24.0, 12.0), (0.0, 12.0), (0.0, 0.0)]
_ROUTES = {
    "leave": [_WEST, _EAST, (18.0, 0.0), (0.0, 0.0), (0.0, 12.0), (5.0, 12.0)],
    "enter": [(20.0, 0.0), (16.0, 0.0), (0.0, 0.0), (0.0, 12.0), (6.0, 12.0)],
    "other-way": [_WEST, (24.0, 0.0), (24.0, 12.0), (0.0, 12.0), (0.0, 3.0)],
    "loops": [_WEST, *_ROUND * 5, (6.0, 0.0)],
    "never": [(16.0, 0.0), *[(24.0, 0.0), (24.0, 12.0), (16.0, 12.0), (24.0, 12.0), (24.0, 0.0), (16.0, 0.0)] * 3],
    "kidnap": [
        *(_WEST, (9.0, 0.0), (4.0, 0.0), _ALOFT, (24.0, 4.0), (24.0, 12.0), (18.0, 12.0), (24.0, 12.0), (24.0, 0.0)),
        *((0.0, 0.0), (0.0, 8.0)),
    ],
}


def partial(seed: int, route: str) -> World:
    """A ring corridor of 24 x 12 m with rooms; cut through the middle, its map has a frontier in the north and the south."""
    world = ring(24.0, 12.0, 2.4, 4.0, seed)
    return world._replace(route=np.array(_ROUTES[route], float))


_FIRST_STEP_M = 0.03
"""A robot's first reading comes one step after its first way point."""


def two_drives(seed: int, drive: int) -> World:
    """The office twice, for Zhang 2010, section 4: drive 1 sees its western rooms, drive 2 leaves what that saw and comes back.

    The origin is where drive 1 is read first, so that a map of it (`slam-gdr`) and the truth of drive 2 have one frame, but for
    the map's own error.
    """
    world = office(seed)
    middle, doors = world.route[0, 1], np.unique(world.route[1:-2, 0])
    insides = {float(x): float(y) for x, y in world.route if y != middle}
    west, east = [d for d in doors.tolist() if d < 19.0], [d for d in doors.tolist() if d > 26.0]

    def visit(door: float) -> list[tuple[float, float]]:
        return [(door, middle), (door, insides[door]), (door, middle)]

    start = world.route[0] + (_FIRST_STEP_M, 0.0)
    if drive == 1:
        route = [tuple(world.route[0]), *itertools.chain(*map(visit, west)), (3.0, middle)]
    else:
        out = [p for d in (east[0], east[-1]) for p in visit(d)]
        route = [*visit(west[1])[1:], *out, *visit(west[2]), *visit(west[0])[:2]]
    shift = np.tile(start, 2)
    return world._replace(walls=world.walls - shift, route=np.array(route) - start)


def symmetric(seed: int) -> World:
    """A corridor with seven equal rooms on each side, told apart only by two boxes; the eastern end leads out of the map."""
    plan = _Plan(np.random.default_rng(seed))
    for x1, y1, x2, y2 in _edges((0.0, 0.0, 42.0, 14.0)):
        plan.wall(x1, y1, x2, y2)
    for y, (y0, y1) in ((6.0, (0.0, 6.0)), (8.4, (8.4, 14.0))):
        plan.wall(0.0, y, 42.0, y, tuple(3.0 + 6.0 * k for k in range(7)), 1.1)
        for k in range(1, 7):
            plan.wall(6.0 * k, y0, 6.0 * k, y1)
    plan.box(1.0, 7.2, 0.3, 0.3)
    plan.box(14.0, 11.0, 0.6, 0.4)
    middle = 7.2
    route = [(20.0, middle), (9.0, middle), (9.0, 4.0), (9.0, middle), (3.0, middle), (15.0, middle), (15.0, 11.8)]
    return plan.world(
        [*route, (15.0, middle), (40.0, middle), (33.0, middle), (33.0, 4.0), (33.0, middle), (9.0, middle)]
    )


def four_rooms(seed: int, same: bool) -> World:
    """12 x 10 m, four rooms and one corridor, with obstacles (Zhang 2014, section 3).

    same: the rooms are equal, and turned by 180 degrees the plan is itself, but for one box in the corridor.
    """
    plan = _Plan(np.random.default_rng(seed))
    for x1, y1, x2, y2 in _edges((0.0, 0.0, 12.0, 10.0)):
        plan.wall(x1, y1, x2, y2)
    for y in (4.0, 6.0):
        plan.wall(0.0, y, 12.0, y, (3.0, 9.0), 1.0)
    plan.wall(6.0, 0.0, 6.0, 4.0)
    plan.wall(6.0, 6.0, 6.0, 10.0)
    boxes = [((1.2, 1.0), (0.4, 0.6)), ((4.6, 0.7), (0.6, 0.3)), ((7.2, 2.9), (0.3, 0.7)), ((10.6, 1.0), (0.8, 0.4))]
    boxes += [((1.0, 8.6), (0.3, 0.3)), ((4.9, 9.2), (0.5, 0.5)), ((7.3, 7.6), (0.6, 0.4)), ((10.9, 9.0), (0.3, 0.6))]
    if same:
        boxes = [((1.2, 1.0), (0.4, 0.6)), ((4.6, 0.7), (0.6, 0.3))]
        boxes += [((x + 6.0, y), half) for (x, y), half in boxes]
        boxes += [((12.0 - x, 10.0 - y), half) for (x, y), half in boxes]
    for (x, y), (w, h) in [*boxes, ((11.5, 5.6), (0.3, 0.3))]:
        plan.box(x, y, w, h)
    west, east, middle = 3.0, 9.0, 5.0
    route = [(west, 2.6), (2.2, 2.4), (west, 3.0), (west, middle), (west, 7.4), (2.4, 7.2), (west, 7.0), (west, middle)]
    route += [
        (east, middle),
        (east, 2.6),
        (8.6, 2.0),
        (east, 3.0),
        (east, middle),
        (east, 7.2),
        (9.6, 7.8),
        (east, 7.0),
    ]
    return plan.world([*route, (east, middle), (west, middle), (west, 3.0)])


def carried(world: World, seed: int, times: int, way_m: float = 36.0) -> World:
    """The same plan, driven in pieces of `way_m`: after each the robot is carried to another place of the route."""
    rng = np.random.default_rng(seed)
    route, path = world.route, [_ALOFT]
    for _ in range(times + 1):
        at = int(rng.integers(len(route) - 1))
        while len(path) > 1 and np.hypot(*(route[at] - path[-2])) < 5.0:
            at = int(rng.integers(len(route) - 1))
        driven = 0.0
        path.append(tuple(route[at]))
        while driven < way_m:
            step, at = (1, at) if at < len(route) - 1 else (-len(route) + 1, at)
            driven += float(np.hypot(*(route[at + step] - route[at])))
            at += step
            path.append(tuple(route[at]))
        path.append(_ALOFT)
    return world._replace(route=np.array(path[1:-1], float))


def cluttered(world: World, seed: int, boxes_per_10m: float) -> World:
    """The same plan with boxes and parked cars beside the route that no map shows."""
    rng = np.random.default_rng(seed)
    route = world.route[np.isfinite(world.route[:, 0])]
    plan = _Plan(rng)
    for a, b in itertools.pairwise(route):
        length = float(np.hypot(*(b - a)))
        for _ in range(rng.poisson(boxes_per_10m * length / 10.0)):
            along, half = (b - a) / max(length, 1e-9), rng.uniform(0.1, 0.35, 2)
            side = rng.choice([-1.0, 1.0]) * (0.55 + half.max() * 1.42 + rng.uniform(0.0, 1.0))
            x, y = a + rng.random() * (b - a) + side * np.array([-along[1], along[0]])
            if _clearance(route, x, y) > 0.45 + half.max() * 1.42:
                plan.box(float(x), float(y), float(half[0]), float(half[1]), float(rng.uniform(0, np.pi)))
    return world._replace(unmapped=np.round(np.array(plan.segments).reshape(-1, 4), 3))


def _clearance(route: NDArray[np.float64], x: float, y: float) -> float:
    """Distance of a point from the route."""
    a, d = route[:-1], np.diff(route, axis=0)
    t = np.clip(((x - a[:, 0]) * d[:, 0] + (y - a[:, 1]) * d[:, 1]) / np.maximum((d**2).sum(axis=1), 1e-9), 0, 1)
    return float(np.hypot(a[:, 0] + t * d[:, 0] - x, a[:, 1] + t * d[:, 1] - y).min())


WORLDS: dict[str, Callable[[int], World]] = {
    "office": lambda seed: office(seed),
    "paper-40x25": lambda seed: office(seed),
    "paper-60x50": lambda seed: ring(52.0, 42.0, 2.4, 0.0, seed, laps=4),
    "loop-500m": lambda seed: ring(150.0, 100.0, 2.5, 5.0, seed, laps=1),
    "loop-2km": lambda seed: ring(600.0, 400.0, 3.0, 5.0, seed, laps=1),
    "small-loop": lambda seed: ring(12.0, 9.0, 2.0, 4.0, seed, laps=2),
    **{f"partial-{name}": functools.partial(partial, route=name) for name in _ROUTES},
    "office-carried": lambda seed: carried(office(1), seed, 18),
    "office-boxes-few": lambda seed: cluttered(office(1), seed, 3.0),
    "office-boxes-some": lambda seed: cluttered(office(1), seed, 9.0),
    "office-boxes-many": lambda seed: cluttered(office(1), seed, 30.0),
    "partial-furnished": lambda seed: cluttered(partial(seed, route="loops"), seed, 9.0),
    "four-rooms": lambda seed: four_rooms(seed, same=False),
    "four-rooms-same": lambda seed: four_rooms(seed, same=True),
    "partial-symmetric": lambda seed: symmetric(seed),
    "partial-drive-1": lambda seed: two_drives(seed, 1),
    "partial-drive-2": lambda seed: two_drives(seed, 2),
}
"""Name -> world of a seed. `paper-*` are the two of Zhang 2016, section 3.2 (their plans are not public)."""


def rasterize(world: World, resolution_m: float) -> GridMap:
    """The true map: cells that a wall crosses are occupied, all others free.

    Plans are drawn in round numbers: half a cell of shift lets walls run through the middle of cells, not between two.
    """
    low = np.floor(np.minimum(world.walls[:, :2], world.walls[:, 2:]).min(axis=0) / resolution_m) - 2.5
    high = np.ceil(np.maximum(world.walls[:, :2], world.walls[:, 2:]).max(axis=0) / resolution_m) + 2
    cols, rows = (high - low).astype(int)
    cells = np.zeros((rows, cols), np.int8)
    for x1, y1, x2, y2 in world.walls:
        n = int(math.hypot(x2 - x1, y2 - y1) / resolution_m * 4) + 2
        t = np.linspace(0.0, 1.0, n)
        gx = np.floor((x1 + t * (x2 - x1)) / resolution_m - low[0]).astype(int)
        gy = np.floor((y1 + t * (y2 - y1)) / resolution_m - low[1]).astype(int)
        cells[gy, gx] = 1
    return GridMap(cells, resolution_m, Pose2(float(low[0] * resolution_m), float(low[1] * resolution_m), 0.0))


def known_part(grid: GridMap, world: World, share: float) -> GridMap:
    """The true map as a robot would have drawn it: what can be reached from the route, west of `share` of the width."""
    cols = grid.cells.shape[1]
    walls = world.walls[:, [0, 2]]
    west, east = walls.min(), walls.max()
    labels, _ = ndimage.label(grid.cells == 0)
    ok = np.isfinite(world.route[:, 0])
    gx = ((world.route[ok, 0] - grid.origin.x_m) / grid.resolution_m).astype(int)
    gy = ((world.route[ok, 1] - grid.origin.y_m) / grid.resolution_m).astype(int)
    reached = np.isin(labels, np.unique(labels[gy, gx]))
    seen = reached | (ndimage.binary_dilation(reached, np.ones((3, 3))) & (grid.cells == 1))
    if share < 1.0:
        edge = west + share * (east - west)
        seen &= (grid.origin.x_m + (np.arange(cols) + 0.5) * grid.resolution_m < edge)[None, :]
    return grid._replace(cells=np.where(seen, grid.cells, -1).astype(np.int8))
