#pragma once
#include <Eigen/Core>
#include <vector>

namespace anigen::geometry {

/// Parents of a tree through all points whose edges together are as short as possible (Prim 1957), hung up at the point
/// nearest to the mean of all; of equal choices the first. Time grows with the square of the number of points.
/// @param points [J], finite @return [J], -1 for the root; empty without points
/// @throws InputError naming a point that is not finite
std::vector<int> shortest_tree(const std::vector<Eigen::Vector3d>& points);

/// Parents of the likeliest tree where each joint chooses its parent by itself: among all trees with one root the one
/// of largest sum, the diagonal entry of the root included (Chu and Liu 1965, Edmonds 1967, by LEMON; the one root by a
/// source whose every edge costs more than all others together). Where the largest entries of the rows are a tree
/// already, it is that tree.
/// @param log_likelihood [J, J], finite: entry (i, m) of m being the parent of i, (i, i) of i being the root
/// @return [J], -1 for the root; empty without joints @throws InputError for another shape or an entry not finite
std::vector<int> likeliest_tree(const Eigen::MatrixXd& log_likelihood);

}  // namespace anigen::geometry
