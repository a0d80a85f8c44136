#include "anigen/geometry/uv_atlas/texel_filling.h"

#include <algorithm>
#include <utility>

#include "anigen/core/numeric.h"

namespace anigen::geometry {
namespace {

struct FillingLevel {
  int size;
  std::vector<char> known;
  std::vector<Eigen::Vector3f> texels;
};

/// Half the size, rounded up: means of the known ones among four.
FillingLevel coarser(const FillingLevel& fine) {
  FillingLevel coarse;
  coarse.size = (fine.size + 1) / 2;
  coarse.known.assign(at(coarse.size) * at(coarse.size), 0);
  coarse.texels.assign(coarse.known.size(), Eigen::Vector3f::Zero());
  for (int y = 0; y < coarse.size; ++y) {
    for (int x = 0; x < coarse.size; ++x) {
      Eigen::Vector3f sum = Eigen::Vector3f::Zero();
      int count = 0;
      for (int row = 2 * y; row < std::min(2 * y + 2, fine.size); ++row) {
        for (int column = 2 * x; column < std::min(2 * x + 2, fine.size); ++column) {
          const std::size_t texel = at(row) * at(fine.size) + at(column);
          if (fine.known[texel] == 0) continue;
          sum += fine.texels[texel];
          ++count;
        }
      }
      if (count == 0) continue;
      const std::size_t texel = at(y) * at(coarse.size) + at(x);
      coarse.texels[texel] = sum / static_cast<float>(count);
      coarse.known[texel] = 1;
    }
  }
  return coarse;
}

/// The coarse texels to either side of a fine one: three quarters of the one it lies in, a quarter of the other.
struct CoarseTaps {
  int near, far;
};

CoarseTaps coarse_taps(int fine, int coarse_size) {
  const int near = fine / 2, far = fine % 2 == 0 ? near - 1 : near + 1;
  return {near, std::clamp(far, 0, coarse_size - 1)};
}

void fill_from(const FillingLevel& coarse, FillingLevel& fine) {
  const auto texel = [&](int x, int y) -> const Eigen::Vector3f& {
    return coarse.texels[at(y) * at(coarse.size) + at(x)];
  };
  for (int y = 0; y < fine.size; ++y) {
    const CoarseTaps row = coarse_taps(y, coarse.size);
    for (int x = 0; x < fine.size; ++x) {
      const std::size_t index = at(y) * at(fine.size) + at(x);
      if (fine.known[index] != 0) continue;
      const CoarseTaps column = coarse_taps(x, coarse.size);
      fine.texels[index] = 0.75F * (0.75F * texel(column.near, row.near) + 0.25F * texel(column.far, row.near)) +
                           0.25F * (0.75F * texel(column.near, row.far) + 0.25F * texel(column.far, row.far));
    }
  }
}

}  // namespace

void fill_unknown_texels(int size, const std::vector<char>& known, std::vector<Eigen::Vector3f>& texels) {
  std::vector<FillingLevel> levels;
  levels.push_back({size, known, std::move(texels)});
  while (levels.back().size > 1) levels.push_back(coarser(levels.back()));
  FillingLevel& top = levels.back();
  if (top.known[0] == 0) top.texels[0].setZero();
  for (std::size_t level = levels.size() - 1; level > 0; --level) fill_from(levels[level], levels[level - 1]);
  texels = std::move(levels.front().texels);
}

}  // namespace anigen::geometry
