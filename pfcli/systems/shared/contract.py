"""What a system must provide, and what it hands over. `docs/add-a-system.md` walks through it.

A system is a record (`System`) found by the entry point `pfcli.systems`, and a filter (`Filter`): five names of its module.
Everything else follows from these: the command and its options, `--params`, the docs page, Parquet schemas, charts, tests.
"""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, Protocol, TypeVar

from pfcli.systems.shared.chart import Chart

if TYPE_CHECKING:  # reading a record imports neither numpy nor a kernel
    import numpy as np
    from numpy.typing import NDArray

    from pfcli.core.grid.grid_map import GridMap
    from pfcli.dropped import Dropped
    from pfcli.initial import Initial
    from pfcli.rng import Draw

ParamsT = TypeVar("ParamsT")
AssetsT = TypeVar("AssetsT")
StateT = TypeVar("StateT")
ReadingT = TypeVar("ReadingT")
InfoT = TypeVar("InfoT")


class System(NamedTuple):
    """The record of a system. Reading it imports no kernel: `filter` is resolved on use.

    name: of its command; summary: one line for `--help`; params: its Params class (`pfcli.params`); filter: `module:name` of its
    `Filter`; needs: alternatives, each a set of event kinds that is enough to run; wants: kinds that are read whenever the log
    has them; map: it needs `--map`; frame: `given` (poses are in the frame of a map or field: `--initial` and
    `--heading-prior` follow) or `own`; readings: what its users call what it is fed; unusable: what none of them does where
    nothing could be estimated; charts: of its report; classes: names of `particle_class`; codes: of its own findings, such as
    `slam-gdr:W1`, and their titles; confidence: the column of its track (0 .. 1) that says how sure it is, which colours
    pictures; equations: rows of the first table of its PAPER.md, at least; example: a run for the contract tests;
    variants: whole records behind flags of the command.
    """

    name: str
    summary: str
    params: type
    filter: str
    needs: tuple[frozenset[str], ...]
    wants: tuple[str, ...] = ()
    map: bool = False
    frame: str = "own"
    readings: str = "scans"
    unusable: str = "has a usable beam (see --max-range-m)"
    charts: tuple[Chart, ...] = ()
    classes: tuple[str, ...] = ()
    codes: "Mapping[str, str]" = MappingProxyType({})
    confidence: str = ""
    equations: int = 0
    example: "Example | None" = None
    variants: "Mapping[str, System]" = MappingProxyType({})

    @property
    def key(self) -> str:
        """Its name as one word, for files and for `pfcli params`."""
        return self.name.replace(" --", "-")


class Example(NamedTuple):
    """A run on a sample log, for the contract tests. log: a name in `sample_logs/`, or a path beside the tests; options: words of
    the command; map: of the localiser, likewise."""

    log: str
    options: tuple[str, ...] = ()
    map: str = ""


class Job(Protocol):
    """What `load` may ask of the run."""

    @property
    def map_file(self) -> Path:
        """The map's YAML file. Raises UsageError where none was given."""
        ...

    @property
    def initial(self) -> "Initial":
        """Where the robot may be at the start."""
        ...

    @property
    def max_map_mpx(self) -> float:
        """Largest map that may be read (million pixels)."""
        ...

    @property
    def unknown_grey(self) -> int:
        """A shade of the map that is unknown whatever its thresholds say (-1: none)."""
        ...

    def sweeps(self) -> "Iterator[Any]":
        """All readings of the run, from its start, for what is learnt of them beforehand."""
        ...


class Filter(NamedTuple, Generic[ParamsT, AssetsT, ReadingT, StateT, InfoT]):
    """The functions of a system, and the type of its rows.

    info: a NamedTuple of scalars, one row of `metrics.parquet` for each update: its annotations are the schema, its suffixes
    the units. load: tables and maps, made once. init: the state before the first reading, which is given. step: the next reading
    (a `pfcli.events.Sweep`, `Sounding` or `Sighting`); it owns the state that it is given, and nothing else; its Info, or None
    where nothing was updated. finish: what the run hands over. Random numbers come from `draw(purpose, stamp_ns)` only.
    """

    info: type[InfoT]
    load: Callable[[ParamsT, Job], AssetsT]
    init: "Callable[[ParamsT, AssetsT, ReadingT, Draw], StateT]"
    step: "Callable[[StateT, ReadingT, AssetsT, ParamsT, Draw], tuple[StateT, InfoT | None]]"
    finish: "Callable[[StateT, AssetsT, ParamsT], Result]"


AnyFilter = Filter[Any, Any, Any, Any, Any]
"""A filter whose types are its own affair."""


class Track(NamedTuple):
    """Pose of every scan: stamps (n,) ns, poses (n, 3) m, rad in the map frame; columns: more of equal length."""

    stamps_ns: "NDArray[np.int64]"
    poses: "NDArray[np.float64]"
    columns: dict[str, Any]


class Frame(NamedTuple):
    """One drawn update: estimate (3,) m, rad (NaN where there is none), particles (k, 3), their classes uint8 (k,; 0 where the
    system has none), and the scan's end points in the base frame (b, 2), m."""

    stamp_ns: int
    pose: "NDArray[np.float64]"
    particles: "NDArray[np.float64]"
    labels: "NDArray[np.uint8]"
    scan_m: "NDArray[np.float64]"


class Result(NamedTuple):
    """What every system hands over at the end of a run.

    track; grid: the map that was built or localised in; frames; summary: scalars for run.json; layers: more maps by
    name; tables: more tables by name, columns of equal length; texts: more files by
    name; given_frame: poses are in the frame of a map or field that was given, not in one of the system's own;
    dropped: what the system itself left out or doubts.
    """

    track: Track
    grid: "GridMap | None"
    frames: list[Frame]
    summary: dict[str, Any]
    layers: "Mapping[str, GridMap]" = MappingProxyType({})
    tables: Mapping[str, dict[str, Any]] = MappingProxyType({})
    texts: Mapping[str, str] = MappingProxyType({})
    given_frame: bool = False
    dropped: "Dropped | None" = None
