#include "anigen/metrics/transport_plan.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <string>

#include "anigen/core/error.h"

namespace anigen::metrics {

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

void check_masses(const Eigen::VectorXd& masses, const std::string& side) {
  for (Eigen::Index i = 0; i < masses.size(); ++i) {
    if (!std::isfinite(masses[i]) || masses[i] < 0.0)
      throw InputError("", side + " " + std::to_string(i), "its mass is negative or not finite");
  }
  if (!(masses.sum() > 0.0)) throw InputError("", side, "there is no mass");
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

std::vector<PlanCell> plan_cells(const Eigen::MatrixXd& plan) {
  std::vector<PlanCell> cells;
  for (Eigen::Index i = 0; i < plan.rows(); ++i) {
    for (Eigen::Index j = 0; j < plan.cols(); ++j) {
      if (plan(i, j) > 0.0) cells.push_back({static_cast<int>(i), static_cast<int>(j), plan(i, j)});
    }
  }
  return cells;
}

Eigen::VectorXd uniform_masses(std::size_t n) {
  return Eigen::VectorXd::Constant(static_cast<Eigen::Index>(n), 1.0 / static_cast<double>(n));
}

void check_transport(const Eigen::MatrixXd& cost, const Eigen::VectorXd& a, const Eigen::VectorXd& b) {
  if (cost.size() == 0) throw InputError("", "", "transport between empty sets");
  if (a.size() != cost.rows() || b.size() != cost.cols()) {
    throw InputError("", "",
                     "a cost of " + std::to_string(cost.rows()) + " x " + std::to_string(cost.cols()) + " with " +
                         std::to_string(a.size()) + " and " + std::to_string(b.size()) + " masses");
  }
  if (!cost.allFinite()) throw InputError("", "", "a transport cost is not finite");
  check_masses(a, "source");
  check_masses(b, "sink");
  if (std::abs(a.sum() - b.sum()) > 1e-9 * a.sum()) throw InputError("", "", "the two measures have different mass");
}

}  // namespace anigen::metrics
