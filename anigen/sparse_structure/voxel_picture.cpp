#include "anigen/sparse_structure/voxel_picture.h"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/io/image_resize.h"
#include "anigen/render/contact_sheet.h"

namespace anigen::sparse_structure {

namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;
using torch::Tensor;

constexpr std::uint8_t kShapeBit = 1, kSkeletonBit = 2;
constexpr int kSamplesPerAxis = 2;
constexpr double kHalfExtent = 0.86;  // of the picture, in edges of the grid; the cube itself reaches 0.817
constexpr float kVoxelOpacity = 0.6f;
constexpr float kMostVeil = 0.3f;  // of shape before a skeleton, however many layers there are

const Vector3f kPaper(0.97f, 0.97f, 0.98f), kShapeColor(0.42f, 0.53f, 0.67f), kSkeletonColor(0.96f, 0.50f, 0.09f);
const std::array<float, 3> kFaceLight{0.72f, 0.86f, 1.0f};  // faces across x, y, z

// Direction of rays, and the axes of the image in space.
const Vector3d kForward = Vector3d(-1.0, 1.0, -1.0) / std::sqrt(3.0);
const Vector3d kRight = Vector3d(1.0, 1.0, 0.0) / std::sqrt(2.0);
const Vector3d kUp = Vector3d(-1.0, 1.0, 2.0) / std::sqrt(6.0);

struct VoxelCells {
  int edge = 0;
  std::vector<std::uint8_t> bits;

  void add(const Tensor& grid, std::uint8_t bit) {
    if (!grid.defined()) return;
    const bool cube = grid.dim() == 3 && grid.size(0) == grid.size(1) && grid.size(0) == grid.size(2);
    if (!cube || grid.size(0) == 0) throw Error("a picture of voxels needs a grid [R, R, R]");
    if (edge != 0 && edge != grid.size(0)) throw Error("shape and skeleton lie on grids of different size");
    edge = static_cast<int>(grid.size(0));
    const Tensor here = grid.detach().to(torch::kCPU, torch::kBool).contiguous();
    const bool* values = here.data_ptr<bool>();
    bits.resize(static_cast<std::size_t>(here.numel()), 0);
    for (std::size_t i = 0; i < bits.size(); ++i) bits[i] = static_cast<std::uint8_t>(bits[i] | (values[i] ? bit : 0));
  }
  std::uint8_t at(const std::array<int, 3>& cell) const {
    return bits[(static_cast<std::size_t>(cell[0]) * static_cast<std::size_t>(edge) +
                 static_cast<std::size_t>(cell[1])) *
                    static_cast<std::size_t>(edge) +
                static_cast<std::size_t>(cell[2])];
  }
};

std::size_t direction_axis(int k) { return static_cast<std::size_t>(k); }

/// Walks the cells that a ray passes, front to back (Amanatides and Woo 1987). A stretch of shape counts once, where
/// the ray enters it: layers of a solid do not add up to an opaque block.
Vector3f color_along(const VoxelCells& cells, const Vector3d& origin) {
  double enter = -std::numeric_limits<double>::infinity(), leave = std::numeric_limits<double>::infinity();
  int axis = 0;
  for (int k = 0; k < 3; ++k) {
    const double near = kForward[k] > 0.0 ? 0.0 : cells.edge, far = cells.edge - near;
    const double first = (near - origin[k]) / kForward[k], last = (far - origin[k]) / kForward[k];
    if (first > enter) enter = first, axis = k;
    leave = std::min(leave, last);
  }
  if (enter >= leave) return kPaper;

  std::array<int, 3> cell{};
  Vector3d next, step;
  for (int k = 0; k < 3; ++k) {
    const double place = origin[k] + enter * kForward[k];
    const int index = std::clamp(static_cast<int>(std::floor(place)), 0, cells.edge - 1);
    cell[direction_axis(k)] = index;
    next[k] = enter + ((kForward[k] > 0.0 ? index + 1 : index) - place) / kForward[k];
    step[k] = 1.0 / std::abs(kForward[k]);
  }
  Vector3f veil = Vector3f::Zero();
  float cover = 0.0f;
  bool inside = false;
  for (;;) {
    const std::uint8_t bits = cells.at(cell);
    const float light = kFaceLight[direction_axis(axis)];
    if ((bits & kSkeletonBit) != 0) {
      const float most = cover > kMostVeil ? kMostVeil / cover : 1.0f;
      return most * veil + (1.0f - most * cover) * light * kSkeletonColor;
    }
    if ((bits & kShapeBit) != 0 && !inside) {
      veil += (1.0f - cover) * kVoxelOpacity * light * kShapeColor;
      cover += (1.0f - cover) * kVoxelOpacity;
    }
    inside = (bits & kShapeBit) != 0;
    next.minCoeff(&axis);
    cell[direction_axis(axis)] += kForward[axis] > 0.0 ? 1 : -1;
    if (cell[direction_axis(axis)] < 0 || cell[direction_axis(axis)] >= cells.edge) break;
    next[axis] += step[axis];
  }
  return veil + (1.0f - cover) * kPaper;
}

std::uint8_t color_byte(float value) {
  return static_cast<std::uint8_t>(std::lround(255.0f * std::clamp(value, 0.0f, 1.0f)));
}

bool has_pixels(const io::Image& picture) { return picture.width > 0 && picture.height > 0; }

}  // namespace

io::Image voxel_picture(const VoxelPair& pair, int size) {
  VoxelCells cells;
  cells.add(pair.shape, kShapeBit);
  cells.add(pair.skeleton, kSkeletonBit);
  io::Image picture(size, size);
  const double half = kHalfExtent * cells.edge, count = kSamplesPerAxis * size;
  const Vector3d start = Vector3d::Constant(0.5 * cells.edge) - 2.0 * cells.edge * kForward;
  for (int y = 0; y < size; ++y) {
    for (int x = 0; x < size; ++x) {
      Vector3f sum = Vector3f::Zero();
      for (int sample = 0; sample < kSamplesPerAxis * kSamplesPerAxis; ++sample) {
        const double column = kSamplesPerAxis * x + sample % kSamplesPerAxis + 0.5;
        const double row = kSamplesPerAxis * y + sample / kSamplesPerAxis + 0.5;
        const Vector3d origin =
            start + half * ((2.0 * column / count - 1.0) * kRight + (1.0 - 2.0 * row / count) * kUp);
        sum += cells.edge > 0 ? color_along(cells, origin) : kPaper;
      }
      sum /= static_cast<float>(kSamplesPerAxis * kSamplesPerAxis);
      for (int c = 0; c < 3; ++c) picture.pixel(x, y)[c] = color_byte(sum[c]);
    }
  }
  return picture;
}

io::Image picture_of_planes(const torch::Tensor& planes) {
  const torch::Tensor bytes =
      (planes.detach().to(torch::kCPU).clamp(0.0, 1.0) * 255.0 + 0.5).to(torch::kUInt8).contiguous();
  io::Image image(static_cast<int>(bytes.size(2)), static_cast<int>(bytes.size(1)));
  const std::uint8_t* values = bytes.data_ptr<std::uint8_t>();
  const std::size_t pixels = image.rgba.size() / 4;
  for (std::size_t i = 0; i < pixels; ++i) {
    for (std::size_t c = 0; c < 3; ++c) image.rgba[4 * i + c] = values[c * pixels + i];
  }
  return image;
}

io::Image fitted_picture(const io::Image& picture, int side) {
  const double scale = static_cast<double>(side) / std::max(picture.width, picture.height);
  const auto scaled = [&](int length) { return std::max(1, static_cast<int>(scale * length + 0.5)); };
  return io::resize_lanczos(picture, scaled(picture.width), scaled(picture.height), io::ResizeAlpha::kPremultiplied);
}

void write_voxel_sheet(const std::filesystem::path& png, const std::vector<VoxelSheetRow>& rows,
                       const std::vector<std::string>& columns) {
  if (rows.empty()) throw Error(png.string() + ": a sheet of voxels needs at least one row");
  const bool pictures = std::any_of(rows.begin(), rows.end(), [](const auto& row) { return has_pixels(row.picture); });
  const std::size_t first = pictures ? 1 : 0;
  std::size_t width = 1;
  for (const VoxelSheetRow& row : rows) width = std::max(width, first + row.cells.size());

  std::vector<render::Tile> tiles(rows.size() * width);
  parallel_for(tiles.size(), [&](std::size_t i) {
    const VoxelSheetRow& row = rows[i / width];
    const std::size_t column = i % width;
    render::Tile& tile = tiles[i];
    tile.caption = column >= first && column - first < columns.size() ? columns[column - first] : "";
    if (column == 0) tile.caption = row.label + (tile.caption.empty() ? "" : ": " + tile.caption);
    if (column < first) {
      tile.image = has_pixels(row.picture) ? fitted_picture(row.picture, kVoxelCellSize)
                                           : io::Image(kVoxelCellSize, kVoxelCellSize);
    } else if (column - first < row.cells.size()) {
      tile.image = voxel_picture(row.cells[column - first], kVoxelCellSize);
    } else {
      tile.image = io::Image(kVoxelCellSize, kVoxelCellSize);
    }
  });
  render::SheetOptions options;
  options.columns = static_cast<int>(width);
  options.text_height = 11;
  io::write_png(png, render::contact_sheet(tiles, options));
}

}  // namespace anigen::sparse_structure
