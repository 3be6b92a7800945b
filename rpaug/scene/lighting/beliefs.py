"""What is believed of the light that a recording was made in, in sentences, with how much of it is explained."""

from rpaug.core.types import Scene
from rpaug.scene.lighting import highlights, rig


def described(scene: Scene) -> list[str]:
    """A sentence each on cast shadows and on highlights; none where no camera has both depth and ids."""
    if not any(view.depth and view.ids for view in scene.episode.views.values()):
        return []
    return [_shadows(scene), _highlights(scene)]


def _shadows(scene: Scene) -> str:
    share, explained = rig.told(scene)
    found = rig.find(scene)
    seen = f"shadows pass over {share:.1%} of what rests"
    if found is not None:
        return (
            f"{seen}; {_lamps(len(found.directions))} explain {explained:.0%} of what grows darker"
        )
    if rig.unexplained(scene):
        return f"{seen}, of which lamps explain {explained:.0%}: too little, so shadows stay as recorded"
    return f"{seen}: too little to tell lamps, so edits take none to be there"


def _highlights(scene: Scene) -> str:
    differ, explained = highlights.told(scene)
    found = highlights.find(scene)
    seen = f"{differ:.0%} of the places that two cameras see differ between them"
    if found is not None:
        return f"{seen}; {_lamps(len(found.lamps.directions))}, mirrored, explain {explained:.0%} of that"
    if differ > highlights.OFTEN:
        return f"{seen}, of which mirrored lamps explain {explained:.0%}: too little, so highlights go by hue"
    return f"{seen}: no highlights are told by that"


def _lamps(count: int) -> str:
    return "1 lamp" if count == 1 else f"{count} lamps"
