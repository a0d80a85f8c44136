#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/eval/transport/mass_units.h"
#include "anigen/eval/transport/transport_plan.h"

namespace anigen::eval {

/// Exact transport by LEMON's network simplex: mostly slower than ShortestPathTransport, but other people's code, so it
/// is the oracle of the tests, and the quicker one where masses are split into many units (transport_solver.h). Costs
/// are rounded to whole numbers of at least 2^-44 of their range (with floating-point costs the simplex can cycle),
/// masses as in mass_units; the cost returned is recomputed from the plan in double precision.
/// @param cost [n,m], @param a [n], @param b [m]  @throws InputError as check_transport
TransportPlan network_simplex_transport(const Eigen::MatrixXd& cost, const Eigen::VectorXd& a,
                                        const Eigen::VectorXd& b);

/// The same on masses in units. @param cost [n,m] finite
/// @param rounding by how much the plan's cost, in units * cost, may at most exceed the optimum
/// @return the cells of the plan, masses in units, sorted by row then column
std::vector<PlanCell> network_simplex_cells(const RowMatrix& cost, const MassUnits& units, double& rounding);

}  // namespace anigen::eval
