#include "anigen/generate/picture_colors.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/core/parallel.h"
#include "anigen/geometry/nearest_point.h"
#include "anigen/render/scene.h"
#include "anigen/vision/picture_estimator.h"

namespace anigen::generate {

namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;
using Eigen::Vector4f;

constexpr float kSquarest = 0.5F, kFlattest = 0.15F;  // cosines between which the picture's part rises from 0 to 1
constexpr double kEroded = 0.008;                     // sides of the picture that an object's edge is not trusted for
constexpr double kMirrorDistance = 0.015;             // of a vertex from the mirror image of a seen one
constexpr float kSurfaceOffset = 2e-3F;               // units off the surface from which a vertex looks for the eye

// Distance in pixels from the nearest pixel outside the object, at most `most`: two passes of a chamfer of 1 and √2.
std::vector<float> depth_inside(const io::Image& picture, float most) {
  const int width = picture.width, height = picture.height;
  std::vector<float> depth(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  const auto at = [&](int x, int y) -> float& {
    return depth[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x)];
  };
  const auto nearer = [&](int x, int y, int dx, int dy, float step) {
    const int u = x + dx, v = y + dy;
    const bool outside = u < 0 || v < 0 || u >= width || v >= height;
    at(x, y) = std::min(at(x, y), (outside ? 0.0F : at(u, v)) + step);
  };
  constexpr std::uint8_t kOpaque = 128;
  constexpr float kDiagonal = 1.41421356F;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      at(x, y) = picture.pixel(x, y)[3] >= kOpaque ? most : 0.0F;
      if (at(x, y) == 0.0F) continue;
      nearer(x, y, -1, 0, 1.0F);
      nearer(x, y, 0, -1, 1.0F);
      nearer(x, y, -1, -1, kDiagonal);
      nearer(x, y, 1, -1, kDiagonal);
    }
  }
  for (int y = height; y-- > 0;) {
    for (int x = width; x-- > 0;) {
      if (at(x, y) == 0.0F) continue;
      nearer(x, y, 1, 0, 1.0F);
      nearer(x, y, 0, 1, 1.0F);
      nearer(x, y, 1, 1, kDiagonal);
      nearer(x, y, -1, 1, kDiagonal);
    }
  }
  return depth;
}

class PictureSampler {
 public:
  explicit PictureSampler(const io::Image& picture)
      : picture_(picture),
        trusted_(std::max(1.0F, static_cast<float>(kEroded * picture.width))),
        depth_(depth_inside(picture, 4.0F * trusted_)) {}

  // Linear colour between the four pixels around a place in [0, 1]²; nothing near the object's edge.
  std::optional<Vector3f> at(double u, double v) const {
    const double x = u * picture_.width - 0.5, y = v * picture_.height - 0.5;
    const int left = static_cast<int>(std::floor(x)), top = static_cast<int>(std::floor(y));
    if (left < 0 || top < 0 || left + 1 >= picture_.width || top + 1 >= picture_.height) return std::nullopt;
    const auto fx = static_cast<float>(x - left), fy = static_cast<float>(y - top);
    Vector3f sum = Vector3f::Zero();
    for (int dy = 0; dy < 2; ++dy) {
      for (int dx = 0; dx < 2; ++dx) {
        const std::size_t place = static_cast<std::size_t>(top + dy) * static_cast<std::size_t>(picture_.width) +
                                  static_cast<std::size_t>(left + dx);
        if (depth_[place] < trusted_) return std::nullopt;
        const std::uint8_t* rgba = picture_.pixel(left + dx, top + dy);
        const float weight = (dx == 0 ? 1.0F - fx : fx) * (dy == 0 ? 1.0F - fy : fy);
        for (int c = 0; c < 3; ++c) sum[c] += weight * render::srgb_to_linear(static_cast<float>(rgba[c]) / 255.0F);
      }
    }
    return sum;
  }

 private:
  const io::Image& picture_;
  float trusted_;
  std::vector<float> depth_;
};

// Colours of vertices in pictures, and how much they count, in [0, 1].
struct SeenColors {
  std::vector<float> weights;
  std::vector<Vector3f> colors;
};

/// Takes over the colours of a picture where it shows vertices squarer than those before it.
/// @param camera [1, 7] @param places [V, 3] the vertices
void look_from(const Asset& asset, const std::vector<Vector3f>& normals, const render::Scene& scene,
               const io::Image& picture, const torch::Tensor& camera, const torch::Tensor& places, SeenColors& found) {
  const std::vector<Vector3f>& vertices = asset.mesh.vertices;
  const torch::Tensor seen = vision::seen_from(camera, places)[0].contiguous();
  const float *uv = seen.data_ptr<float>(), *numbers = camera.data_ptr<float>();
  const double yaw = std::atan2(numbers[0], numbers[1]), pitch = numbers[2];
  const Vector3d back(std::cos(yaw) * std::cos(pitch), std::sin(yaw) * std::cos(pitch), std::sin(pitch));
  constexpr double kLeastNearness = 0.01;
  const Vector3d eye = back / std::max(kLeastNearness, static_cast<double>(numbers[6]));
  const PictureSampler sampler(picture);
  parallel_for(vertices.size(), [&](std::size_t i) {
    const Vector3d place = vertices[i].cast<double>();
    const Vector3d towards = (eye - place).normalized();
    const float cosine = normals[i].dot(towards.cast<float>());
    const float weight = std::min(1.0F, (cosine - kFlattest) / (kSquarest - kFlattest));
    if (cosine <= kFlattest || weight <= found.weights[i]) return;
    const Vector3f start = vertices[i] + kSurfaceOffset * normals[i];
    if (scene.occluded(start, towards.cast<float>(), static_cast<float>((eye - place).norm()))) return;
    const std::optional<Vector3f> color = sampler.at(uv[3 * i], uv[3 * i + 1]);
    if (!color) return;
    found.weights[i] = weight;
    found.colors[i] = *color;
  });
}

}  // namespace

PaintedVertices paint_from_pictures(Asset& asset, const std::vector<io::Image>& pictures,
                                    const torch::Tensor& cameras) {
  Mesh& mesh = asset.mesh;
  const std::size_t count = mesh.vertices.size();
  PaintedVertices painted;
  if (count == 0 || mesh.colors.size() != count) return painted;
  const torch::Tensor rows = cameras.to(torch::kCPU, torch::kFloat32).reshape({-1, vision::kCameraNumbers});
  TORCH_CHECK(rows.size(0) == static_cast<std::int64_t>(pictures.size()), "one camera per picture");
  torch::Tensor places = torch::empty({static_cast<std::int64_t>(count), 3});
  for (std::size_t i = 0; i < count; ++i) {
    for (int axis = 0; axis < 3; ++axis)
      places.data_ptr<float>()[3 * i + static_cast<std::size_t>(axis)] = mesh.vertices[i][axis];
  }
  const std::vector<Vector3f> normals = angle_weighted_normals(mesh.vertices, mesh.faces);
  const render::Scene scene(asset);
  SeenColors found{std::vector<float>(count, 0.0F), std::vector<Vector3f>(count, Vector3f::Zero())};
  for (std::size_t view = 0; view < pictures.size(); ++view) {
    const torch::Tensor camera = rows.narrow(0, static_cast<std::int64_t>(view), 1).contiguous();
    look_from(asset, normals, scene, pictures[view], camera, places, found);
  }
  const std::vector<float>& weights = found.weights;
  const std::vector<Vector3f>& colors = found.colors;

  std::vector<std::size_t> owners;
  std::vector<Vector3d> points;
  for (std::size_t i = 0; i < count; ++i) {
    if (weights[i] <= 0.0F) continue;
    owners.push_back(i);
    points.push_back(mesh.vertices[i].cast<double>());
  }
  if (owners.empty()) {
    painted.decoded = count;
    return painted;
  }
  const geometry::PointIndex index(std::move(points));
  std::vector<Vector4f> result = mesh.colors;
  for (std::size_t i = 0; i < count; ++i) {
    const auto blend = [&](const Vector3f& color, float weight) {
      result[i].head<3>() += weight * (color - result[i].head<3>());
    };
    // The mirror image first: where the view is flat it is better than what was decoded.
    Vector3d mirrored = mesh.vertices[i].cast<double>();
    mirrored.x() = -mirrored.x();
    const geometry::PointIndex::Nearest nearest = index.nearest(mirrored);
    const bool has_twin = nearest.squared <= kMirrorDistance * kMirrorDistance;
    if (has_twin && weights[i] < 1.0F) blend(colors[owners[nearest.index]], weights[owners[nearest.index]]);
    blend(colors[i], weights[i]);
    (weights[i] > 0.0F ? painted.seen : has_twin ? painted.mirrored : painted.decoded) += 1;
  }
  mesh.colors = std::move(result);
  return painted;
}

}  // namespace anigen::generate
