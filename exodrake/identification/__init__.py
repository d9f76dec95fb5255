"""Identification from recordings: kinematics, workspace, joint stiffness, and the maximum tension of each tendon.

kinematics.identify            axes, centres and angles from markers, by bundle adjustment
kinematics.screws              the paper's way: product of exponentials and Newton's iteration (Eq. 7-18, corrected)
stiffness.fit_stiffness        joint stiffness and rest posture through the nonlinear statics (Eq. 19-20)
joint_compliance               constant-stiffness map between tension and angle, and its inverse (Eq. 21-22, corrected)
maximum_tension                the tension of each tendon that maximises the movement (Section 2.3)
workspace                      areas that the fingertip reaches (Fig. 13)
"""
