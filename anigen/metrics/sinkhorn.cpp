#include "anigen/metrics/sinkhorn.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/core/kernel_form.h"

namespace anigen::metrics::kernels {

namespace {

// The compiler may not reorder a minimum of doubles on its own; of several independent ones it keeps a vector.
constexpr int kLanes = 8;

ANIGEN_KERNEL_INLINE double least_of(const double* lanes) {
  double result = lanes[0];
  for (int k = 1; k < kLanes; ++k) result = lanes[k] < result ? lanes[k] : result;
  return result;
}

}  // namespace

ANIGEN_EXACT_KERNEL(double, relax,
                    (const double* __restrict costs, const double* __restrict potential, double offset, double number,
                     double* __restrict distance, double* __restrict previous, int n),
                    (costs, potential, offset, number, distance, previous, n)) {
  double lanes[kLanes];
  for (double& lane : lanes) lane = std::numeric_limits<double>::infinity();
  int j = 0;
  for (; j + kLanes <= n; j += kLanes) {
    for (int k = 0; k < kLanes; ++k) {
      const double through = costs[j + k] - potential[j + k] - offset, before = distance[j + k];
      previous[j + k] = through < before ? number : previous[j + k];
      const double now = through < before ? through : before;
      distance[j + k] = now;
      lanes[k] = now < lanes[k] ? now : lanes[k];
    }
  }
  for (; j < n; ++j) {
    const double through = costs[j] - potential[j] - offset;
    if (through < distance[j]) distance[j] = through, previous[j] = number;
    lanes[0] = distance[j] < lanes[0] ? distance[j] : lanes[0];
  }
  return least_of(lanes);
}

ANIGEN_EXACT_KERNEL(double, least, (const double* values, int n), (values, n)) {
  double lanes[kLanes];
  for (double& lane : lanes) lane = std::numeric_limits<double>::infinity();
  int j = 0;
  for (; j + kLanes <= n; j += kLanes) {
    for (int k = 0; k < kLanes; ++k) lanes[k] = values[j + k] < lanes[k] ? values[j + k] : lanes[k];
  }
  for (; j < n; ++j) lanes[0] = values[j] < lanes[0] ? values[j] : lanes[0];
  return least_of(lanes);
}

ANIGEN_EXACT_KERNEL(void, add_outer,
                    (const double* __restrict levers, const double* __restrict step, double* __restrict values, int n,
                     int m),
                    (levers, step, values, n, m)) {
  for (int i = 0; i < n; ++i) {
    const double lever = levers[i];
    double* __restrict row = values + static_cast<std::ptrdiff_t>(i) * m;
    for (int k = 0; k < m; ++k) row[k] += lever * step[k];
  }
}

}  // namespace anigen::metrics::kernels

namespace anigen::metrics {

namespace {

constexpr double kLargestScaling = 1e13;  // e^30
constexpr double kAnnealing = 0.25;
constexpr int kAnnealingIterations = 100;

// One Sinkhorn problem: P = diag(u) K diag(v) with K_ij = exp((f_i + g_j − C_ij) / ε). The potentials f, g survive a
// change of ε and take in ε log u and ε log v before the scalings u, v leave double precision.
class Scaling {
 public:
  Scaling(const Eigen::MatrixXd& cost, const Eigen::VectorXd& a, const Eigen::VectorXd& b)
      : cost_(cost), a_(a), b_(b), f_(Eigen::VectorXd::Zero(a.size())), g_(Eigen::VectorXd::Zero(b.size())) {}

  // @return iterations done
  int run(double epsilon, double tolerance, int max_iterations) {
    epsilon_ = epsilon;
    project_rows();
    project_columns();
    absorb();
    int iteration = 1;
    while (iteration < max_iterations) {
      const Eigen::VectorXd row_sums = kernel_ * v_, column_scale = kernel_.transpose() * divided(a_, row_sums);
      u_ = divided(a_, row_sums);  // u = a / K v, then v = b / Kᵀ u
      v_ = divided(b_, column_scale);
      ++iteration;
      const double largest = std::max(u_.maxCoeff(), v_.maxCoeff());
      const double smallest = std::min(smallest_of(u_, a_), smallest_of(v_, b_));
      if (!std::isfinite(largest) || largest > kLargestScaling || smallest < 1.0 / kLargestScaling) {
        // Too far for plain numbers: two exact steps in the log domain.
        if (std::isfinite(largest) && smallest > 0.0) fold();
        project_rows();
        project_columns();
        absorb();
        ++iteration;
      }
      if (iteration % 5 == 0) {
        error_ = (u_.cwiseProduct(kernel_ * v_) - a_).cwiseAbs().sum();
        if (error_ <= tolerance) break;
      }
    }
    fold();
    absorb();
    error_ = (kernel_.rowwise().sum() - a_).cwiseAbs().sum();
    return iteration;
  }

  const Eigen::MatrixXd& plan() const { return kernel_; }
  const Eigen::VectorXd& f() const { return f_; }
  const Eigen::VectorXd& g() const { return g_; }
  double error() const { return error_; }

 private:
  static Eigen::VectorXd divided(const Eigen::VectorXd& mass, const Eigen::VectorXd& by) {
    return (mass.array() > 0.0).select(mass.array() / by.array(), 0.0);
  }
  static double smallest_of(const Eigen::VectorXd& scaling, const Eigen::VectorXd& mass) {
    return (mass.array() > 0.0).select(scaling.array(), 1.0).minCoeff();
  }
  static double log_mass(double mass) { return mass > 0.0 ? std::log(mass) : -std::numeric_limits<double>::infinity(); }

  // f_i = ε (log a_i − LSE_j((g_j − C_ij) / ε)), and g likewise. Potentials of massless points are minus infinity;
  // everything else stays finite.
  double projected(double mass, const Eigen::ArrayXd& exponents) const {
    const double top = exponents.maxCoeff();
    return epsilon_ * (log_mass(mass) - top - std::log((exponents - top).exp().sum()));
  }
  void project_rows() {
    for (Eigen::Index i = 0; i < a_.size(); ++i)
      f_[i] = projected(a_[i], (g_.transpose() - cost_.row(i)).array().transpose() / epsilon_);
  }
  void project_columns() {
    for (Eigen::Index j = 0; j < b_.size(); ++j) g_[j] = projected(b_[j], (f_ - cost_.col(j)).array() / epsilon_);
  }
  void fold() {
    f_.array() += epsilon_ * u_.array().log();
    g_.array() += epsilon_ * v_.array().log();
  }
  void absorb() {
    kernel_.resize(cost_.rows(), cost_.cols());
    for (Eigen::Index j = 0; j < cost_.cols(); ++j)
      kernel_.col(j) = ((f_.array() + g_[j] - cost_.col(j).array()) / epsilon_).exp();
    u_.setOnes(a_.size());
    v_.setOnes(b_.size());
  }

  const Eigen::MatrixXd& cost_;
  const Eigen::VectorXd &a_, &b_;
  Eigen::VectorXd f_, g_, u_, v_;
  Eigen::MatrixXd kernel_;
  double epsilon_ = 1.0, error_ = 0.0;
};

// Value of the potentials after two c-transforms, which make any start feasible.
double dual_value(const Eigen::MatrixXd& cost, const Eigen::VectorXd& a, const Eigen::VectorXd& b, Eigen::VectorXd g) {
  for (Eigen::Index j = 0; j < g.size(); ++j) {
    if (!std::isfinite(g[j])) g[j] = cost.minCoeff() - cost.maxCoeff();  // massless: any feasible value does
  }
  Eigen::VectorXd f(a.size());
  for (Eigen::Index i = 0; i < a.size(); ++i) f[i] = (cost.row(i).transpose() - g).minCoeff();
  for (Eigen::Index j = 0; j < b.size(); ++j) g[j] = (cost.col(j) - f).minCoeff();
  return a.dot(f) + b.dot(g);
}

void check_options(const SinkhornOptions& options) {
  if (!(options.epsilon > 0.0)) throw InputError("", "sinkhorn", "epsilon must be positive");
  if (!(options.tolerance >= 0.0)) throw InputError("", "sinkhorn", "the tolerance must not be negative");
  if (options.max_iterations < 1) throw InputError("", "sinkhorn", "at least one iteration is needed");
}

}  // namespace

SinkhornResult sinkhorn(const Eigen::MatrixXd& cost, const Eigen::VectorXd& a, const Eigen::VectorXd& b,
                        const SinkhornOptions& options) {
  check_transport(cost, a, b);
  check_options(options);
  const double largest = cost.cwiseAbs().maxCoeff();
  // All costs zero: any epsilon gives the product plan.
  const double unit = options.absolute ? 1.0 : (largest > 0.0 ? largest : 1.0);
  const double epsilon = options.epsilon * unit, mass = a.sum();

  Scaling scaling(cost, a, b);
  SinkhornResult result;
  for (double warm = options.start_epsilon * unit; warm > epsilon; warm *= kAnnealing)
    scaling.run(warm, 1e-3 * mass, std::min(kAnnealingIterations, options.max_iterations));
  result.iterations = scaling.run(epsilon, options.tolerance * mass, options.max_iterations);
  result.marginal_error = scaling.error();
  result.converged = result.marginal_error <= options.tolerance * mass;
  result.plan = options.round ? round_to_coupling(scaling.plan(), a, b) : scaling.plan();
  result.cost = (result.plan.array() * cost.array()).sum();
  result.lower_bound = dual_value(cost, a, b, scaling.g());
  result.row_potential = scaling.f();
  result.column_potential = scaling.g();
  return result;
}

Eigen::MatrixXd round_to_coupling(const Eigen::MatrixXd& plan, const Eigen::VectorXd& a, const Eigen::VectorXd& b) {
  Eigen::MatrixXd rounded = plan;
  const Eigen::VectorXd rows = rounded.rowwise().sum();
  for (Eigen::Index i = 0; i < a.size(); ++i) {
    if (rows[i] > a[i]) rounded.row(i) *= a[i] / rows[i];
  }
  const Eigen::VectorXd columns = rounded.colwise().sum();
  for (Eigen::Index j = 0; j < b.size(); ++j) {
    if (columns[j] > b[j]) rounded.col(j) *= b[j] / columns[j];
  }
  const Eigen::VectorXd missing_rows = (a - rounded.rowwise().sum()).cwiseMax(0.0);
  const Eigen::VectorXd missing_columns = (b - rounded.colwise().sum().transpose()).cwiseMax(0.0);
  const double missing = missing_rows.sum();
  if (missing > 0.0) rounded += missing_rows * missing_columns.transpose() / missing;
  return rounded;
}

}  // namespace anigen::metrics
