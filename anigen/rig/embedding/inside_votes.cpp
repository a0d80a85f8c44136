#include "anigen/rig/embedding/inside_votes.h"

#include <algorithm>
#include <cmath>

namespace anigen::rig {
namespace {

constexpr int kVotesInside = 4;

/// Whether the number of crossings below a cell is odd, for all cells of a box, along one axis. A crossing flips all
/// cells above it, so that crossings need not be kept.
class CrossingParity {
 public:
  CrossingParity(const std::array<int, 3>& low, const std::array<int, 3>& size, int axis)
      : axis_(at(axis)), u_((axis_ + 1) % 3), v_((axis_ + 2) % 3), low_(low), size_(size) {
    words_ = (at(size[axis_]) + 63) / 64;
    bits_.assign(at(size[u_]) * at(size[v_]) * words_, 0);
    total_.assign(at(size[u_]) * at(size[v_]), 0);
  }

  /// Corners in cells: the centre of cell (0, 0, 0) of the grid is the origin.
  void add(const std::array<Eigen::Vector3d, 3>& corners, const Triangle& numbers) {
    // Rays a little beside the centres: on models, edges like to run exactly through them.
    constexpr double kBesideU = 1.37e-4, kBesideV = 2.71e-4;
    std::array<double, 3> x{}, y{}, z{};
    for (std::size_t k = 0; k < 3; ++k) {
      x[k] = corners[k][static_cast<Eigen::Index>(u_)] - low_[u_] - kBesideU;
      y[k] = corners[k][static_cast<Eigen::Index>(v_)] - low_[v_] - kBesideV;
      z[k] = corners[k][static_cast<Eigen::Index>(axis_)] - low_[axis_];
    }
    const auto [x_low, x_high] = std::minmax_element(x.begin(), x.end());
    const auto [y_low, y_high] = std::minmax_element(y.begin(), y.end());
    const int i_first = std::max(0, static_cast<int>(std::ceil(*x_low)));
    const int i_last = std::min(size_[u_] - 1, static_cast<int>(std::floor(*x_high)));
    const int j_first = std::max(0, static_cast<int>(std::ceil(*y_low)));
    const int j_last = std::min(size_[v_] - 1, static_cast<int>(std::floor(*y_high)));
    for (int j = j_first; j <= j_last; ++j) {
      for (int i = i_first; i <= i_last; ++i) {
        std::array<double, 3> w{};
        int positive = 0;
        for (std::size_t k = 0; k < 3; ++k) {
          // Always from the lower to the higher vertex, so that both faces of an edge see the same number.
          std::size_t a = (k + 1) % 3, b = (k + 2) % 3;
          const bool swapped = numbers[a] > numbers[b];
          if (swapped) std::swap(a, b);
          const double side = (x[b] - x[a]) * (j - y[a]) - (y[b] - y[a]) * (i - x[a]);
          positive += (side >= 0.0) != swapped ? 1 : 0;
          w[k] = swapped ? -side : side;
        }
        if (positive != 0 && positive != 3) continue;
        const double sum = w[0] + w[1] + w[2];
        if (sum == 0.0) continue;
        cross(i, j, (w[0] * z[0] + w[1] * z[1] + w[2] * z[2]) / sum);
      }
    }
  }

  /// Odd crossings along the rays to both sides of a cell of the box.
  int votes(const std::array<int, 3>& cell) const {
    const std::size_t column = at(cell[v_]) * at(size_[u_]) + at(cell[u_]);
    const std::uint64_t word = bits_[column * words_ + at(cell[axis_]) / 64];
    const int below = static_cast<int>(word >> (cell[axis_] % 64) & 1);
    return below + (below ^ total_[column]);
  }

 private:
  void cross(int i, int j, double depth) {
    const std::size_t column = at(j) * at(size_[u_]) + at(i);
    total_[column] ^= 1;
    const double last = size_[axis_];
    const auto first = static_cast<std::size_t>(std::clamp(std::floor(depth) + 1.0, 0.0, last));
    for (std::size_t w = first / 64; w < words_; ++w) {
      const bool starts_here = w == first / 64;
      bits_[column * words_ + w] ^= starts_here ? ~std::uint64_t{0} << (first % 64) : ~std::uint64_t{0};
    }
  }

  std::size_t axis_, u_, v_;
  std::array<int, 3> low_, size_;
  std::size_t words_;
  std::vector<std::uint64_t> bits_;
  std::vector<std::uint8_t> total_;
};

}  // namespace

void mark_surrounded(const std::vector<Eigen::Vector3d>& vertices, const std::vector<Triangle>& all_faces,
                     const std::vector<int>& faces, const CellGrid& grid, std::vector<std::uint8_t>& inside) {
  const auto corners_of = [&](int f) {
    std::array<Eigen::Vector3d, 3> corners;
    for (std::size_t k = 0; k < 3; ++k) {
      corners[k] = (vertices[at(all_faces[at(f)][k])] - grid.origin) / grid.spacing;
    }
    return corners;
  };
  Box box;
  for (const int f : faces) {
    for (const Eigen::Vector3d& corner : corners_of(f)) box.extend(corner);
  }
  std::array<int, 3> low{}, size{};
  for (int axis = 0; axis < 3; ++axis) {
    const auto k = at(axis);
    low[k] = std::clamp(static_cast<int>(std::floor(box.low[axis])), 0, grid.size[k] - 1);
    const int high = std::clamp(static_cast<int>(std::ceil(box.high[axis])), low[k], grid.size[k] - 1);
    size[k] = high - low[k] + 1;
  }
  std::array<CrossingParity, 3> axes{CrossingParity(low, size, 0), CrossingParity(low, size, 1),
                                     CrossingParity(low, size, 2)};
  for (const int f : faces) {
    const auto corners = corners_of(f);
    for (CrossingParity& axis : axes) axis.add(corners, all_faces[at(f)]);
  }
  for (int z = 0; z < size[2]; ++z) {
    for (int y = 0; y < size[1]; ++y) {
      for (int x = 0; x < size[0]; ++x) {
        int votes = 0;
        for (const CrossingParity& axis : axes) votes += axis.votes({x, y, z});
        if (votes >= kVotesInside) inside[grid.index(low[0] + x, low[1] + y, low[2] + z)] = 1;
      }
    }
  }
}

}  // namespace anigen::rig
