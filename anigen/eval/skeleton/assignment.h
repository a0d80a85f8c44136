#pragma once
#include <Eigen/Core>
#include <vector>

namespace anigen::eval {

/// Matrices with more entries are refused; the time grows with the third power of the smaller side.
inline constexpr double kLargestAssignment = 4e6;

/// The linear assignment problem, exact: pairs as many rows and columns as the smaller side has, each at most once, at
/// the least total cost (shortest augmenting paths with potentials, O(min² · max); Jonker and Volgenant 1987).
/// @param cost [R, C], finite, any sign
/// @return [R]: the column of each row, -1 for rows that got none
/// @throws InputError for an entry that is not finite, or beyond kLargestAssignment
std::vector<int> assign(const Eigen::MatrixXd& cost);

}  // namespace anigen::eval
