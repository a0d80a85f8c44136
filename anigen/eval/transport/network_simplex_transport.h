#pragma once
#include <Eigen/Core>

#include "anigen/eval/transport/transport_plan.h"

namespace anigen::eval {

/// Exact transport by LEMON's network simplex: slower than ShortestPathTransport, but other people's code, so it is the
/// oracle of the tests. Costs are rounded to whole numbers of at least 2^-44 of their range (with floating-point costs
/// the simplex can cycle), masses as in mass_units; the cost returned is recomputed from the plan in double precision.
/// @param cost [n,m], @param a [n], @param b [m]  @throws InputError as check_transport
TransportPlan network_simplex_transport(const Eigen::MatrixXd& cost, const Eigen::VectorXd& a,
                                        const Eigen::VectorXd& b);

}  // namespace anigen::eval
