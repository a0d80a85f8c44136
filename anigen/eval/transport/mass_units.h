#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace anigen::eval {

/// Masses as whole numbers, so that flows are exact and an optimal plan is a true vertex. Equal masses 1/n and 1/m
/// become m/gcd(n,m) and n/gcd(n,m) units without any rounding; other masses are shares of 2^40 units, rounded by
/// largest remainders (relative error about 1e-12).
struct MassUnits {
  std::vector<std::int64_t> supplies, demands;  ///< [n], [m]; equal sums
  std::int64_t total = 0;                       ///< their sum: one unit is the share 1/total of the mass
  bool uniform = false;                         ///< both measures have equal masses
};

/// @param a [n], @param b [m]  checked by check_transport
MassUnits mass_units(const Eigen::VectorXd& a, const Eigen::VectorXd& b);

}  // namespace anigen::eval
