#pragma once
#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <vector>

namespace anigen::geometry {

/// Nearest point of a set, exactly: a k-d tree (nanoflann), set up once, queried from any thread, in double precision.
/// Of equally near points the lowest index.
class PointIndex {
 public:
  struct Nearest {
    std::size_t index = 0;
    double squared = std::numeric_limits<double>::max();  ///< squared distance
  };

  /// Copies the points. @throws InputError without points, or naming one that is not finite or beyond 1e100
  explicit PointIndex(std::vector<Eigen::Vector3d> points);

  std::size_t size() const;
  const Eigen::Vector3d& point(std::size_t index) const;

  /// @param query finite, within 1e100
  Nearest nearest(const Eigen::Vector3d& query) const;
  /// As above, quicker by a guess: the answer of a query nearby. @pre guess < size()
  Nearest nearest(const Eigen::Vector3d& query, std::size_t guess) const;
  /// One index per query, in order; runs on all threads. @throws InputError naming a query that is not finite or beyond
  /// 1e100
  std::vector<std::size_t> nearest(const std::vector<Eigen::Vector3d>& queries) const;

 private:
  struct Implementation;
  std::shared_ptr<const Implementation> implementation_;  ///< copies share it
};

/// Squared distance in single precision, summed x, y, z: what every neighbour rule below compares.
inline float squared_distance(const Eigen::Vector3f& a, const Eigen::Vector3f& b) {
  const float x = a.x() - b.x(), y = a.y() - b.y(), z = a.z() - b.z();
  return x * x + y * y + z * z;
}

/// Points sorted into cubes half as wide as a radius, for questions about what lies within that radius of each of them.
/// Each cube knows the box around its points, so that one crowded cube is skipped as a whole when it is out of reach.
/// The answers are those of comparing all pairs in single precision, also at the edge of the radius.
class PointCells {
 public:
  struct Neighbour {
    int index;
    float squared;  ///< squared_distance to the point asked about
  };
  using Visit = std::function<void(std::size_t point, const std::vector<Neighbour>& neighbours)>;

  /// @param points copied; finite, at most 1e15 in absolute value @param radius in [1e-12, 1e12]
  PointCells(const std::vector<Eigen::Vector3f>& points, float radius);

  /// Calls visit once for every point, on all threads and in no order, with its first `most` neighbours in ascending
  /// index order: those whose squared distance is strictly below radius² in single precision, the point itself included
  /// (the published ball query). Indices are merged across the cubes in reach, so a query ends with its last hit:
  /// thousands of points in one place cost no more than `most` of them.
  void first_neighbours(std::size_t most, const Visit& visit) const;

  /// Indices, in no order, of all points whose distance (the root of squared_distance) to a point is at most the
  /// radius.
  std::vector<int> within(std::size_t point) const;

 private:
  using Key = std::array<std::int32_t, 3>;
  struct Cell {
    Key key;
    std::size_t begin, end;     // into order_ and sorted_
    Eigen::Vector3f low, high;  // box of its points
  };
  class Surroundings;
  struct Run;

  Key key_of(const Eigen::Vector3f& point) const;
  bool in_reach(const Cell& cell, const Eigen::Vector3f& point) const;
  std::size_t first_cell_from(const Key& key) const;
  void merge_runs(const Eigen::Vector3f& point, std::size_t most, std::vector<Run>& runs,
                  std::vector<Neighbour>& found) const;

  float radius_;
  double cell_size_;
  std::vector<Eigen::Vector3f> points_, sorted_;  // as given; cell by cell
  std::vector<int> order_;                        // index of each sorted point, ascending within a cell
  std::vector<Cell> cells_;                       // by key
};

}  // namespace anigen::geometry
