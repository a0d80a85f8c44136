#include "anigen/eval/align/rotation_starts.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

namespace anigen::eval {
namespace {

constexpr double kTwoPi = 6.283185307179586;
constexpr double kAmbiguous = 1.1;  // ratio of variances below which two axes may be swapped

bool ambiguous(const Eigen::Vector3d& ascending) {
  return ascending[1] < kAmbiguous * ascending[0] || ascending[2] < kAmbiguous * ascending[1];
}

}  // namespace

Eigen::Matrix3d random_rotation(Rng& rng) {
  const double u = rng.uniform(), v = kTwoPi * rng.uniform(), w = kTwoPi * rng.uniform();
  const double a = std::sqrt(1.0 - u), b = std::sqrt(u);
  return Eigen::Quaterniond(b * std::cos(w), a * std::sin(v), a * std::cos(v), b * std::sin(w))
      .normalized()
      .toRotationMatrix();
}

std::vector<Eigen::Matrix3d> random_rotations(int count, std::uint64_t seed) {
  std::vector<Eigen::Matrix3d> rotations;
  for (int i = 0; i < count; ++i) {
    Rng rng(seed, "alignment rotation", static_cast<std::uint64_t>(i));
    rotations.push_back(random_rotation(rng));
  }
  return rotations;
}

std::vector<Eigen::Matrix3d> principal_axis_rotations(const Eigen::Matrix3d& from_covariance,
                                                      const Eigen::Matrix3d& to_covariance) {
  if (!(from_covariance.trace() > 0.0) || !(to_covariance.trace() > 0.0)) return {};
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> from(from_covariance), to(to_covariance);
  const bool all = ambiguous(from.eigenvalues()) || ambiguous(to.eigenvalues());
  std::vector<Eigen::Matrix3d> rotations;
  std::array<int, 3> order = {0, 1, 2};
  do {
    for (int signs = 0; signs < 8; ++signs) {
      Eigen::Matrix3d axes;
      for (int k = 0; k < 3; ++k) {
        axes.col(k) = (signs & (1 << k) ? -1.0 : 1.0) * from.eigenvectors().col(order[static_cast<std::size_t>(k)]);
      }
      const Eigen::Matrix3d rotation = to.eigenvectors() * axes.transpose();
      if (rotation.determinant() > 0.0) rotations.push_back(rotation);
    }
  } while (all && std::next_permutation(order.begin(), order.end()));
  return rotations;
}

}  // namespace anigen::eval
