"""When an answer counts as the truth: classes that no log can tell apart, and parameters under the names of both
sides.
"""

SOFTER_WIRE = ("tendon.stiffness", "tendon.wire_stiffness", "tendon.softness")


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
    """Whether each interval of the first effect holds the true value: list of bools.

    exact: look at parameters that mean the same on both sides, else at those that mean nearly the same. Intervals per
    channel count one by one, for the channels of the truth. Empty if the first effect has another id than the truth.
    """
    if top_id(diagnosis) != truth["id"] or bool(truth["exact"]) != exact:
        return []
    hits = []
    for name, value in truth["parameters"].items():
        for interval in intervals_of(name, truth, diagnosis["effects"][0]):
            low, high = interval.get("low"), interval.get("high")
            if low is not None and high is not None:
                hits.append(low <= value <= high)
    return hits


def intervals_of(name, truth, stated):
    """Intervals of one parameter: per channel if given, else the overall one."""
    seat = (*truth["wires"], *truth["joints"])
    channels = (stated.get("channels") or {}).get(name) or {}
    if channels:
        return [interval for channel, interval in channels.items() if not seat or channel in seat]
    overall = (stated.get("parameters") or {}).get(name)
    return [overall] if overall else []
