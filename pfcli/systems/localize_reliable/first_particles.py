"""The first particles, and what is learnt of the map before the first scan is judged."""

import hashlib
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pfcli.core import particles
from pfcli.core.jit import SOURCES, cache_root
from pfcli.core.sensor.class_conditional import Model, Scan
from pfcli.errors import LogError, OutputError, UsageError
from pfcli.events import Sweep
from pfcli.formats.atomic import output_file
from pfcli.rng import Purpose, rng_for
from pfcli.systems.localize_reliable import global_sampler, success_decision
from pfcli.systems.localize_reliable.map_models import Assets, gain_of, view_of
from pfcli.systems.localize_reliable.params import Params
from pfcli.systems.localize_reliable.success_decision import Classifier

_STAGES = ((0.4, 0.2, 0.08), (0.2, 0.1, 0.04), (0.1, 0.04, 0.02))
UNSURE = 4
"""So many times more particles are kept while no hypothesis holds nine tenths of the mass."""


def scatter(scan: Scan, model: Model, assets: Assets, params: Params, rng: np.random.Generator) -> NDArray[np.float64]:
    """(n, 3) poses as `--initial` says, gathered where the first scan fits."""
    initial = assets.initial
    if initial.kind == "pose":
        return particles.gaussian(np.array(initial.pose), np.array(initial.sd), params.particles, rng)
    half = assets.grid.resolution_m / 2
    pose = particles.uniform(assets.start_xy, half, params.start_particles, rng, initial.heading)
    wanted = min(UNSURE * params.particles, pose.shape[0])
    return global_sampler.gather(pose, _STAGES, wanted, scan, assets.field, model, gain_of(params, scan), rng)


def classifier_for(sweep: Sweep, model: Model, assets: Assets, params: Params) -> Classifier:
    """The decision model for this scanner: the user's, or learnt from the map, once: it is kept in the cache folder.

    Only the map, the scanner and the parameters have a part in what is learnt, not the run's seed, so that it is the same
    whether it was kept or not.
    """
    view = view_of(sweep, params)
    if params.classifier:
        return success_decision.load(Path(params.classifier), assets.digest, view)
    about = repr((view.mount.tolist(), view.angles.tolist(), view.range_m, tuple(model)))
    name = hashlib.sha256(about.encode()).hexdigest()[:16]
    path = cache_root() / "classifiers" / f"{SOURCES}-{assets.digest[:24]}-{name}.json"
    with suppress(LogError, UsageError):
        return success_decision.load(path, assets.digest, view)
    found = success_decision.learn(assets.free_xy, assets.field, model, view, rng_for(0, Purpose.CALIBRATE, 0))
    with suppress(OutputError, OSError), output_file(path) as partial:
        success_decision.save(partial, found, assets.digest)
    return found
