"""Uno's options and the kinds of their values: casadi tells of neither."""

from collections.abc import Mapping

_WHOLE = """
    loose_tolerance_iteration_threshold max_iterations filter_capacity funnel_update_strategy
    quasi_newton_memory_size
"""
_REAL = """
    primal_tolerance dual_tolerance loose_primal_tolerance loose_dual_tolerance time_limit
    unbounded_objective_threshold residual_scaling_threshold armijo_decrease_fraction
    armijo_tolerance switching_delta switching_infeasibility_exponent filter_beta filter_gamma
    filter_ubd filter_fact funnel_kappa funnel_beta funnel_gamma funnel_ubd funnel_fact
    LS_backtracking_ratio LS_min_step_length LBFGS_delta_upper_bound LSR1_pivot_max_magnitude
    dual_regularization_fraction primal_regularization_lb regularization_failure_threshold
    regularization_increase_factor primal_regularization_initial_factor TR_radius
    TR_increase_factor TR_decrease_factor TR_aggressive_decrease_factor TR_activity_tolerance
    TR_min_radius TR_radius_reset_threshold barrier_initial_parameter
    barrier_default_multiplier barrier_tau_min barrier_k_sigma barrier_k_mu barrier_theta_mu
    barrier_k_epsilon barrier_update_fraction barrier_damping_factor
    protected_actual_reduction_macheps_coefficient l1_constraint_violation_coefficient
    least_square_multiplier_max_norm barrier_regularization_exponent
    barrier_small_direction_factor barrier_push_variable_to_interior_k1
    barrier_push_variable_to_interior_k2
"""
_FLAGS = """
    print_solution print_subproblem LS_scale_duals_with_step_length
    protect_actual_reduction_against_roundoff
    switch_to_optimality_requires_linearized_feasibility
"""
_WORDS = """
    logger hessian_model inertia_correction_strategy progress_norm residual_norm filter_type
    inequality_handling_method globalization_mechanism globalization_strategy
    constraint_relaxation_strategy BQPD_kmax_heuristic QP_solver LP_solver linear_solver
"""
_KINDS: tuple[tuple[type, str], ...] = (
    (int, _WHOLE),
    (float, _REAL),
    (bool, _FLAGS),
    (str, f"preset {_WORDS}"),
)
KINDS: Mapping[str, type] = {name: kind for kind, names in _KINDS for name in names.split()}
WANTED: Mapping[type, str] = {
    int: "a whole number",
    float: "a number",
    bool: "yes or no",
    str: "a word of Uno's documentation",
}
WORDS: Mapping[str, tuple[str, ...]] = {
    "preset": ("filtersqp", "filterslp", "funnelsqp", "ipopt"),
    "logger": ("SILENT", "WARNING", "INFO", "DEBUG", "DEBUG2", "DEBUG3"),
}
