#include "anigen/eval/transport/transport_plan.h"

#include <cmath>
#include <string>

#include "anigen/core/error.h"

namespace anigen::eval {
namespace {

void check_masses(const Eigen::VectorXd& masses, const std::string& side) {
  for (Eigen::Index i = 0; i < masses.size(); ++i) {
    if (!std::isfinite(masses[i]) || masses[i] < 0.0)
      throw InputError("", side + " " + std::to_string(i), "its mass is negative or not finite");
  }
  if (!(masses.sum() > 0.0)) throw InputError("", side, "there is no mass");
}

}  // namespace

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

}  // namespace anigen::eval
