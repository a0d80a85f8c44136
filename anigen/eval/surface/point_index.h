#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <memory>
#include <vector>

namespace anigen::eval {

/// Nearest point of a set, exactly: a k-d tree, set up once, queried from any thread, in double precision. Which of
/// several equally near points comes back is fixed for a set and a query, but otherwise open.
class PointIndex {
 public:
  struct Nearest {
    std::size_t index = 0;
    double squared = 0.0;  ///< squared distance
  };

  /// Copies the points. @throws InputError without points, or naming one that is not finite or beyond 1e100
  explicit PointIndex(std::vector<Eigen::Vector3d> points);
  ~PointIndex();
  PointIndex(PointIndex&&) noexcept;
  PointIndex& operator=(PointIndex&&) noexcept;

  std::size_t size() const;
  const Eigen::Vector3d& point(std::size_t index) const;

  Nearest nearest(const Eigen::Vector3d& query) const;
  /// As near a point, found from a guess, which only makes it quicker: the answer of a query nearby.
  /// @pre guess < size()
  Nearest nearest(const Eigen::Vector3d& query, std::size_t guess) const;

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace anigen::eval
