"""What a robot is, from recordings of it: kinematics, workspace, joint stiffness, the joint-angle estimator."""
