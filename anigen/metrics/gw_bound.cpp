#include "anigen/metrics/gw_bound.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "anigen/metrics/wasserstein.h"

namespace anigen::metrics {

namespace {

constexpr double kRounding = 1e-12;

// All distances with the masses of their pairs, sorted.
void distance_distribution(const Eigen::MatrixXd& c, const Eigen::VectorXd& a, Eigen::VectorXd& values,
                           Eigen::VectorXd& masses) {
  const Eigen::MatrixXd pairs = a * a.transpose();
  const Eigen::VectorXd distances = Eigen::Map<const Eigen::VectorXd>(c.data(), c.size());
  const std::vector<int> order = ascending(distances);
  values = picked(distances, order);
  masses = picked(Eigen::Map<const Eigen::VectorXd>(pairs.data(), pairs.size()), order);
}

// Second lower bound: W2² on the line between the distributions of d1(x, x') and d2(y, y').
double global_bound(const Eigen::MatrixXd& c1, const Eigen::MatrixXd& c2, const Eigen::VectorXd& a,
                    const Eigen::VectorXd& b) {
  Eigen::VectorXd x, y, p, q;
  distance_distribution(c1, a, x, p);
  distance_distribution(c2, b, y, q);
  return line_cost(x, p, y, q);
}

// Third lower bound: min over couplings of Σ costs_ik π_ik with costs_ik = W2²(d1(i, ·), d2(k, ·)).
double local_bound(const RowMatrix& costs, const Eigen::VectorXd& a, const Eigen::VectorXd& b) {
  const MassUnits units = mass_units(a, b);
  TransportSolver transport(units);
  transport.solve(costs);
  return transport.lower_bound() / static_cast<double>(units.total);
}

// Eigenvalues of D^(1/2) C D^(1/2) on the complement of the vector sqrt(a), downwards. That vector itself adds a 0.
Eigen::VectorXd centred_spectrum(const Eigen::MatrixXd& c, const Eigen::VectorXd& a) {
  const Eigen::VectorXd root = a.cwiseSqrt() / std::sqrt(a.sum());
  Eigen::MatrixXd scaled = root.asDiagonal() * c * root.asDiagonal();
  const Eigen::VectorXd image = scaled * root;
  scaled -= image * root.transpose() + root * image.transpose();
  scaled += root.dot(image) * root * root.transpose();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(scaled, Eigen::EigenvaluesOnly);
  return solver.eigenvalues().reverse();
}

/// Minimum over couplings of the linear part about the product plan plus the least the quadratic part can be: the
/// scaled deviation from the product has singular values of at most 1, so by von Neumann's inequality the quadratic
/// part is at most the sum of products of the sorted eigenvalues of the centred distance matrices (the projected
/// eigenvalue bound of Hadley, Rendl and Wolkowicz 1992, extended to couplings). Squared; O(n^3 + m^3).
double spectral_bound(const Eigen::MatrixXd& c1, const Eigen::MatrixXd& c2, const Eigen::VectorXd& a,
                      const Eigen::VectorXd& b) {
  // Σ C1² a a + Σ C2² b b − 2 max <C1 π C2, π>, with π = a bᵀ + deviation: the linear part about a bᵀ by sorting, the
  // quadratic part of the deviation by Σ λ_k μ_k over sorted eigenvalues of the centred distances.
  const Eigen::VectorXd mean1 = c1 * a, mean2 = c2 * b;
  const double squares = a.dot(c1.cwiseAbs2() * a) + b.dot(c2.cwiseAbs2() * b);
  const MassUnits units = mass_units(a, b);
  double linear = 0.0;  // the largest <(C1 a)(C2 b)^T, plan>, reached by sorting both
  for (const PlanCell& cell : monotone_coupling(units, ascending(mean1), ascending(mean2)))
    linear += cell.mass / static_cast<double>(units.total) * mean1[cell.row] * mean2[cell.column];
  const Eigen::VectorXd spectrum1 = centred_spectrum(c1, a), spectrum2 = centred_spectrum(c2, b);
  double quadratic = 0.0;  // largest positive with largest positive, most negative with most negative
  for (Eigen::Index k = 0; k < std::min(spectrum1.size(), spectrum2.size()); ++k) {
    quadratic += std::max(spectrum1[k], 0.0) * std::max(spectrum2[k], 0.0);
    quadratic +=
        std::min(spectrum1[spectrum1.size() - 1 - k], 0.0) * std::min(spectrum2[spectrum2.size() - 1 - k], 0.0);
  }
  return squares - 2.0 * (2.0 * linear - a.dot(mean1) * b.dot(mean2) + quadratic);
}

}  // namespace

RowMatrix profile_costs(const Eigen::MatrixXd& c1, const Eigen::MatrixXd& c2, const Eigen::VectorXd& a,
                        const Eigen::VectorXd& b) {
  const Eigen::Index n = c1.rows(), m = c2.rows();
  const MassUnits units = mass_units(a, b);
  // Sorted distances seen from each joint, one column per joint, with the masses they have unless all are equal.
  const auto sorted = [&](const Eigen::MatrixXd& c, const Eigen::VectorXd& masses, Eigen::MatrixXd& distances,
                          Eigen::MatrixXd& their_masses) {
    for (Eigen::Index i = 0; i < c.rows(); ++i) {
      if (units.uniform) {
        std::sort(distances.col(i).data(), distances.col(i).data() + c.rows());
        continue;
      }
      const std::vector<int> order = ascending(c.col(i));
      distances.col(i) = picked(c.col(i), order);
      their_masses.col(i) = picked(masses, order);
    }
  };
  Eigen::MatrixXd x = c1, y = c2, p(n, n), q(m, m);
  sorted(c1, a, x, p);
  sorted(c2, b, y, q);
  RowMatrix costs(n, m);
  if (!units.uniform) {
    for (Eigen::Index i = 0; i < n; ++i) {
      for (Eigen::Index k = 0; k < m; ++k) costs(i, k) = line_cost(x.col(i), p.col(i), y.col(k), q.col(k));
    }
    return costs;
  }
  // With equal masses every pair shares one monotone coupling, and the cross term is a matrix product.
  const double unit = 1.0 / static_cast<double>(units.total);
  Eigen::MatrixXd coupled = Eigen::MatrixXd::Zero(n, m);
  const std::vector<int> rows = ascending(Eigen::VectorXd::Zero(n)), columns = ascending(Eigen::VectorXd::Zero(m));
  for (const PlanCell& cell : monotone_coupling(units, rows, columns))
    coupled.row(cell.row) += cell.mass * unit * y.row(cell.column);
  costs.noalias() = -2.0 * x.transpose() * coupled;
  const Eigen::VectorXd first = x.colwise().squaredNorm() / static_cast<double>(n);
  const Eigen::RowVectorXd second = y.colwise().squaredNorm() / static_cast<double>(m);
  costs.colwise() += first;
  costs.rowwise() += second;
  return costs.cwiseMax(0.0);
}

GwLowerBound gw_lower_bound(const Eigen::MatrixXd& c1, const Eigen::MatrixXd& c2, const Eigen::VectorXd& a,
                            const Eigen::VectorXd& b) {
  // Masses that are not equal are themselves rounded to 2^-40 (mass_units()).
  const double masses = mass_units(a, b).uniform ? 0.0 : std::ldexp(static_cast<double>(a.size() + b.size()), -39);
  const double largest = std::max(c1.maxCoeff(), c2.maxCoeff()), rounding = (kRounding + masses) * largest * largest;
  const auto root = [&](double squared) { return std::sqrt(std::max(squared - rounding, 0.0)); };
  GwLowerBound bound;
  bound.global_distances = root(global_bound(c1, c2, a, b));
  bound.local_distances = root(local_bound(profile_costs(c1, c2, a, b), a, b));
  bound.spectral = root(spectral_bound(c1, c2, a, b));
  bound.best = std::max({bound.global_distances, bound.local_distances, bound.spectral});
  return bound;
}

}  // namespace anigen::metrics
