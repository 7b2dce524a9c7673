"""Parameters by which the derivatives of ready-made diagrams are checked: a new diagram is entered here alone."""

DERIVATIVES = {
    "fig07_observer": ["forward.gain", "wear.gain", "grip.gain", "zeta.integral"],
    "fig08_slope": ["loading.gain", "unloading.gain"],
    "eq11_compensator": ["observer.wear.gain", "slope.loading.gain"],
    "fig09a_without_feedforward": ["controller.kp", "motor.K", "tsm.theta", "tsm.zeta", "ref.amplitude"],
    "fig09b_feedforward": ["theta", "tsm.alpha1", "compensator.A", "controller.kd", "motor.tau"],
    "fig16_feedforward_feedback": ["pid.kp", "pid.ki", "alpha1", "delta"],
    "observer_on_motor": ["alpha1", "theta", "controller.ki"],
    "loop_around_model": ["alpha2", "delta", "gain.gain"],
    "motor_linear": ["motor.K", "motor.tau", "motor.speed"],
    "belt_drive": ["motor.K", "motor.tau", "belt.omega", "belt.zeta", "belt.rate"],
    "flexible_joint": ["motor_inverse_inertia.gain", "spring.gain", "weight.gain", "link_angle.integral"],
    "two_tanks": ["pump.gain", "upper_outlet.gain", "lower_outlet.exponent", "lower.integral"],
    "tendon_sheath_linear": ["gain.gain", "offset.bias"],
    "tendon_sheath_symmetric": ["tsm.beta", "tsm.gamma", "tsm.n", "tsm.A", "tsm.alpha_x"],
    "tendon_sheath_asymmetric": ["tsm.alpha1", "tsm.alpha2", "tsm.A", "tsm.theta", "tsm.delta", "offset.bias"],
    "tendon_sheath_play": ["play.half_width", "play.gain"],
    "tendon_sheath_backlash": ["tsm.c1", "tsm.c2", "tsm.B1", "tsm.B2"],
    "tendon_sheath_generalized": ["tsm.A", "tsm.n", "tsm.beta1", "tsm.beta5", "tsm.alpha_zeta", "offset.bias"],
    "tendon_sheath_prandtl_ishlinskii": ["tsm.weight0", "tsm.weights[1]", "tsm.radii[0]"],
    "tendon_sheath_elastic_backlash": [
        *("tsm.alpha_x", "tsm.rho", "tsm.half_width", "tsm.roundness", "tsm.growth_up", "tsm.growth_down", "tsm.zeta")
    ],
    "fig09b_elementary": "the same equations as fig09b_feedforward, proved equal in test_paper.py",
    "sampled_position_loop": "its encoder rounds the angle, so its outputs jump with every parameter",
}
"""Parameters of each diagram, a few of each kind (gains, hysteresis, initial states, tied ones), or why it has none."""
SMOOTH = {name: entry for name, entry in DERIVATIVES.items() if not isinstance(entry, str)}
JUMPS = {"tendon_sheath_play", "tendon_sheath_backlash", "tendon_sheath_prandtl_ishlinskii"}
"""Diagrams with plays: the derivative jumps at each reversal, and a difference may be that of the other side."""
