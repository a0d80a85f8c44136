#pragma once
#include <Eigen/Core>

#include "anigen/eval/transport/transport_plan.h"

namespace anigen::eval {

enum class ExactSolver {
  kAutomatic,       ///< whichever is the quicker one for these sizes: transport_solver.h
  kShortestPaths,   ///< ours, quick for equal and for small sizes: shortest_path_transport.h
  kNetworkSimplex,  ///< LEMON's, the oracle: network_simplex_transport.h
};

/// The cheapest coupling of masses a and b, min <plan, cost>, exact up to the rounding of double precision. The plan is
/// a vertex (at most n + m - 1 positive entries); where several are optimal it is one of them.
/// @param cost [n,m], @param a [n], @param b [m]  nonnegative, of equal sums  @throws InputError as check_transport
TransportPlan exact_transport(const Eigen::MatrixXd& cost, const Eigen::VectorXd& a, const Eigen::VectorXd& b,
                              ExactSolver solver = ExactSolver::kAutomatic);

}  // namespace anigen::eval
