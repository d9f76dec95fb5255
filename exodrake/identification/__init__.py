"""Identification from recordings: kinematics, workspace, joint stiffness, and the maximum tension of each tendon.

kinematics.identify     axes, centres and angles from markers, by bundle adjustment
kinematics.rigid        rigid motions, screws and Newton's iteration as in the paper (Eq. 4-18, corrected)
kinematics.markers      marker recordings, also synthetic; label check; clock from the sync pulse (Fig. 5 and 8a)
statics                 joint stiffness and rest posture by nonlinear statics (Eq. 19-20), and at
                        constant stiffness the map from tension to angle and its inverse (Eq. 21-22, corrected);
                        the tension of each tendon that maximises the movement (Section 2.3)
workspace               areas that the fingertip reaches (Fig. 13)
"""
