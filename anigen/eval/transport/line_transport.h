#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/eval/transport/mass_units.h"
#include "anigen/eval/transport/transport_plan.h"

namespace anigen::eval {

/// Indices that sort `values` upwards; equal values keep their order.
std::vector<int> ascending(const Eigen::VectorXd& values);
/// result[k] = values[order[k]]
Eigen::VectorXd picked(const Eigen::VectorXd& values, const std::vector<int>& order);

/// The coupling that gives the first rows in `row_order` to the first columns in `column_order`: optimal between points
/// on a line for any convex cost when both orders go upwards. Masses in units.
std::vector<PlanCell> monotone_coupling(const MassUnits& units, const std::vector<int>& row_order,
                                        const std::vector<int>& column_order);

/// Squared Wasserstein-2 distance of two distributions on a line.
/// @param x, y sorted upwards @param a, b their masses, of equal sums
double line_cost(const Eigen::VectorXd& x, const Eigen::VectorXd& a, const Eigen::VectorXd& y,
                 const Eigen::VectorXd& b);

}  // namespace anigen::eval
