#include "anigen/eval/transport/mass_units.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace anigen::eval {
namespace {

bool equal_masses(const Eigen::VectorXd& masses) {
  const double mean = masses.mean();
  return (masses.array() - mean).abs().maxCoeff() <= 1e-14 * mean;
}

std::vector<std::int64_t> shares(const Eigen::VectorXd& masses, std::int64_t total) {
  const double sum = masses.sum();
  std::vector<std::int64_t> units(static_cast<std::size_t>(masses.size()));
  std::vector<double> remainders(units.size());
  std::int64_t given = 0;
  for (std::size_t i = 0; i < units.size(); ++i) {
    const double exact = masses[static_cast<Eigen::Index>(i)] / sum * static_cast<double>(total);
    units[i] = static_cast<std::int64_t>(std::floor(exact));
    remainders[i] = exact - static_cast<double>(units[i]);
    given += units[i];
  }
  std::vector<std::size_t> order(units.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t x, std::size_t y) { return remainders[x] > remainders[y]; });
  for (std::size_t k = 0; given < total; ++k, ++given) ++units[order[k % order.size()]];
  // Rounding of the shares can also overshoot by a few units.
  for (std::size_t k = 0; given > total; ++k) {
    std::int64_t& last = units[order[order.size() - 1 - k % order.size()]];
    if (last > 0) --last, --given;
  }
  return units;
}

}  // namespace

MassUnits mass_units(const Eigen::VectorXd& a, const Eigen::VectorXd& b) {
  MassUnits units;
  units.uniform = equal_masses(a) && equal_masses(b);
  if (units.uniform) {
    const std::int64_t n = a.size(), m = b.size(), common = std::gcd(n, m);
    units.supplies.assign(static_cast<std::size_t>(n), m / common);
    units.demands.assign(static_cast<std::size_t>(m), n / common);
    units.total = n / common * m;
  } else {
    units.total = std::int64_t{1} << 40;
    units.supplies = shares(a, units.total);
    units.demands = shares(b, units.total);
  }
  return units;
}

}  // namespace anigen::eval
