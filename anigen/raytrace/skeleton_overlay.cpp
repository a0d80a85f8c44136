#include "anigen/raytrace/skeleton_overlay.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "anigen/core/error.h"
#include "anigen/raytrace/palette.h"

namespace anigen::raytrace {
namespace {

/// One capsule of changing radius in the picture; a dot when both ends coincide.
struct Capsule {
  Eigen::Vector2d from, to;
  double radius_from, radius_to;
  double depth;  ///< of the middle, for the order of drawing
  Eigen::Vector3f color;
};

/// How much of the pixel around (x, y) the capsule grown by `grow` covers.
double coverage(const Capsule& capsule, double x, double y, double grow) {
  const Eigen::Vector2d p(x, y), along = capsule.to - capsule.from;
  const double squared = along.squaredNorm();
  const double t = squared > 0.0 ? std::clamp((p - capsule.from).dot(along) / squared, 0.0, 1.0) : 0.0;
  const double radius = (1.0 - t) * capsule.radius_from + t * capsule.radius_to + grow;
  return std::clamp(radius - (p - capsule.from - t * along).norm() + 0.5, 0.0, 1.0);
}

/// Straight-alpha "over".
void blend(std::uint8_t* pixel, const Eigen::Vector3f& color, double alpha) {
  const double below = pixel[3] / 255.0 * (1.0 - alpha), total = alpha + below;
  if (total <= 0.0) return;
  for (int c = 0; c < 3; ++c) {
    const double value = (255.0 * std::clamp(color[c], 0.0f, 1.0f) * alpha + pixel[c] * below) / total;
    pixel[c] = static_cast<std::uint8_t>(std::lround(std::clamp(value, 0.0, 255.0)));
  }
  pixel[3] = static_cast<std::uint8_t>(std::lround(std::clamp(255.0 * total, 0.0, 255.0)));
}

void draw(io::Image& image, const Capsule& capsule, const Eigen::Vector3f& outline, double rim) {
  const double reach = std::max(capsule.radius_from, capsule.radius_to) + rim + 1.0;
  const auto low = [&](double a, double b) { return std::min(a, b) - reach; };
  const auto high = [&](double a, double b) { return std::max(a, b) + reach; };
  const auto pixel_range = [](double value, int size) {
    return static_cast<int>(std::clamp(value, 0.0, double(size)));
  };
  const int x0 = pixel_range(low(capsule.from.x(), capsule.to.x()), image.width);
  const int x1 = pixel_range(high(capsule.from.x(), capsule.to.x()) + 1.0, image.width);
  const int y0 = pixel_range(low(capsule.from.y(), capsule.to.y()), image.height);
  const int y1 = pixel_range(high(capsule.from.y(), capsule.to.y()) + 1.0, image.height);
  for (int y = y0; y < y1; ++y) {
    for (int x = x0; x < x1; ++x) {
      const double edge = coverage(capsule, x + 0.5, y + 0.5, rim);
      if (edge <= 0.0) continue;
      blend(image.pixel(x, y), outline, 0.85 * edge);
      blend(image.pixel(x, y), capsule.color, coverage(capsule, x + 0.5, y + 0.5, 0.0));
    }
  }
}

void check(const std::vector<Eigen::Vector3d>& positions, const std::vector<int>& parents) {
  if (positions.size() != parents.size()) {
    throw InputError(
        "", "skeleton",
        std::to_string(positions.size()) + " joint positions but " + std::to_string(parents.size()) + " parents");
  }
  for (std::size_t j = 0; j < parents.size(); ++j) {
    if (parents[j] < -1 || parents[j] >= static_cast<int>(parents.size())) {
      throw InputError("", "skeleton.parents[" + std::to_string(j) + "]",
                       "there is no joint " + std::to_string(parents[j]));
    }
    if (!positions[j].allFinite()) {
      throw InputError("", "skeleton.positions[" + std::to_string(j) + "]", "the position is not finite");
    }
  }
}

/// -1 when there is none. Bounded, since the parents of a broken skeleton may run in a circle.
int shown_ancestor(const std::vector<int>& parents, const std::vector<bool>& shown, std::size_t joint) {
  int above = parents[joint];
  for (std::size_t step = 0; above >= 0 && step < parents.size(); ++step) {
    if (shown.empty() || shown[static_cast<std::size_t>(above)]) return above;
    above = parents[static_cast<std::size_t>(above)];
  }
  return -1;
}

}  // namespace

void draw_skeleton(io::Image& image, const Camera& camera, const std::vector<Eigen::Vector3d>& positions,
                   const std::vector<int>& parents, const OverlayStyle& style, const std::vector<bool>& shown) {
  check(positions, parents);
  if (!shown.empty() && shown.size() != positions.size()) {
    throw InputError("", "shown", "must have one entry per joint");
  }
  if (!(style.thickness > 0.0 && style.thickness <= 100.0)) {
    throw InputError("", "thickness", "must be above 0 and at most 100");
  }
  if (!style.bone.allFinite() || !style.joint.allFinite() || !style.outline.allFinite()) {
    throw InputError("", "skeleton_style", "a colour is not finite");
  }
  const double size = style.thickness * std::max(1.6, 0.0085 * std::min(image.width, image.height));
  const double rim = std::max(0.9, 0.35 * size);
  std::vector<Eigen::Vector3d> projected(positions.size());
  std::vector<bool> visible(positions.size());
  for (std::size_t j = 0; j < positions.size(); ++j) {
    projected[j] = camera.project(positions[j]);
    visible[j] =
        (shown.empty() || shown[j]) && projected[j].z() > 0.0 && projected[j].head<2>().cwiseAbs().maxCoeff() < 1e7;
  }
  std::vector<Capsule> bones, dots;
  for (std::size_t j = 0; j < positions.size(); ++j) {
    if (!visible[j]) continue;
    const Eigen::Vector2d at = projected[j].head<2>();
    const Eigen::Vector3f own = joint_color(static_cast<int>(j));
    dots.push_back({at, at, 0.9 * size, 0.9 * size, projected[j].z(), style.joint});
    const int above = shown_ancestor(parents, shown, j);
    if (above < 0 || !visible[static_cast<std::size_t>(above)]) continue;
    const auto parent = static_cast<std::size_t>(above);
    bones.push_back({projected[parent].head<2>(), at, 0.85 * size, 0.35 * size,
                     0.5 * (projected[j].z() + projected[parent].z()), style.color_by_joint ? own : style.bone});
  }
  const auto farther = [](const Capsule& a, const Capsule& b) { return a.depth > b.depth; };
  std::stable_sort(bones.begin(), bones.end(), farther);
  std::stable_sort(dots.begin(), dots.end(), farther);
  for (const Capsule& bone : bones) draw(image, bone, style.outline, rim);
  for (const Capsule& dot : dots) draw(image, dot, style.outline, rim);
}

}  // namespace anigen::raytrace
