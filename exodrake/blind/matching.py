"""When an answer counts as the truth: classes that no log can tell apart, and parameters under the names of both
sides.
"""

SOFTER_WIRE = ("tendon.stiffness", "tendon.wire_stiffness", "tendon.softness")
# this reality's parameter names -> what a diagnosis may call them
ALIASES = {}


def accepted_ids(truth):
    """Ids that count as right for one true effect (effects.md, "Not separable"): itself and what is inseparable from
    it.
    """
    name = truth["id"]
    if name == "tendon.slack":
        return {name, "encoder.homing_offset"}
    if name == "encoder.homing_offset" and truth["parameters"]["offset"] < 0:
        return {name, "tendon.slack"}
    if name == "tendon.compliance":
        return {name, *SOFTER_WIRE}
    return {name}


def accepted_blocks(truth):
    """Blocks that count as right for one true effect."""
    return {name.split(".")[0] for name in accepted_ids(truth)}


def top_id(diagnosis):
    """Id of the first effect named, or None."""
    effects = diagnosis.get("effects") or ()
    return effects[0]["id"] if effects else None


def found_ids(diagnosis):
    """All ids named, the class of an AMBIGUOUS verdict included."""
    return {effect["id"] for effect in diagnosis.get("effects") or ()} | set(diagnosis.get("equivalents") or ())


def covered(truth, diagnosis, exact):
    """Whether each interval of the first effect holds the true value: list of bools, for parameters that mean the
    same on both sides (exact) or only nearly (not exact). Nothing if the first effect has another id than the
    truth.
    """
    if top_id(diagnosis) != truth["id"] or bool(truth["exact"]) != exact:
        return []
    stated = diagnosis["effects"][0].get("parameters") or {}
    hits = []
    for name, value in truth["parameters"].items():
        for key in keys_of(name, truth["id"], stated):
            low, high = stated[key].get("low"), stated[key].get("high")
            if low is not None and high is not None:
                hits.append(low <= value <= high)
    return hits


def keys_of(name, effect_id, stated):
    """Keys of a diagnosis's parameters that state this one, also per wire or joint (`mu_phi_AF`)."""
    names = (name, *ALIASES.get((effect_id, name), ()))
    return [key for key in stated if any(key == wanted or key.startswith(wanted + "_") for wanted in names)]
