"""Grasp planning: from a mode and the size of an object to tensions.

    hand.candidates      all postures that hold a round object between finger and thumb in a mode, in closed form
    plan.holdable        their tensions, within F_min .. F_max and reached from rest
    plan.plan_grasp      the best of them, or the nearest posture that the tendons hold and its shortfall
    plan.run_plan        the plan in the Diagram, with an estimator in slot 8
    figure.grasp_figure  planned, reached and estimated posture

Plane of the finger: origin in the MCP, x along the proximal phalanx at MCP zero, y palmar, as complex x + iy [m].
"""
