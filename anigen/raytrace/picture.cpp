#include "anigen/raytrace/picture.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "anigen/asset/skinning.h"
#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/raytrace/pixel_sum.h"
#include "anigen/raytrace/shading.h"
#include "anigen/raytrace/srgb.h"
#include "anigen/raytrace/surface_color.h"

namespace anigen::raytrace {
namespace {

constexpr int kOcclusionRaysPerPixel = 24;
constexpr int kLargestSize = 16384, kMostSamples = 16;

void check(const PictureOptions& options) {
  const auto check_range = [](int value, int high, const char* option) {
    if (value < 1 || value > high) throw InputError("", option, "must be between 1 and " + std::to_string(high));
  };
  check_range(options.width, kLargestSize, "width");
  check_range(options.height, kLargestSize, "height");
  check_range(options.samples_per_axis, kMostSamples, "samples_per_axis");
  if (options.background && !options.background->allFinite()) {
    throw InputError("", "background", "the colour is not finite");
  }
}

class Painter {
 public:
  Painter(const Scene& scene, const PictureOptions& options, const Camera& camera)
      : scene_(scene),
        options_(options),
        camera_(camera),
        lit_(options.mode == PictureMode::kColor || (options.mode == PictureMode::kWeights && options.light_weights)),
        surface_(scene, options),
        studio_(scene, studio_lights(camera), occlusion_rays(options), options.shadows) {
    if (options.background) {
      background_ = options.background->cwiseMax(0.0f).cwiseMin(1.0f);
      if (display_is_srgb()) background_ = background_.unaryExpr([](float value) { return srgb_to_linear(value); });
    }
  }

  void paint(io::Image& image, int x, int y) const {
    const int n = options_.samples_per_axis;
    PixelSequence sequence(x, y);
    PixelSum sum;
    for (int j = 0; j < n; ++j) {
      for (int i = 0; i < n; ++i) {
        const PixelSum sample = trace(x + (i + 0.5) / n, y + (j + 0.5) / n, sequence);
        sum.add(sample.color, sample.alpha);
      }
    }
    const PixelSum mean = sum.scaled(1.0f / static_cast<float>(n * n));
    (options_.background ? mean.over(background_) : mean).store_straight(image.pixel(x, y), display_is_srgb());
  }

 private:
  static int occlusion_rays(const PictureOptions& options) {
    if (!options.ambient_occlusion) return 0;
    const int samples = options.samples_per_axis * options.samples_per_axis;
    return std::max(1, (kOcclusionRaysPerPixel + samples - 1) / samples);
  }

  /// Normals are numbers, not light: they are stored as they are.
  bool display_is_srgb() const { return options_.mode != PictureMode::kNormals; }

  PixelSum trace(double x, double y, PixelSequence& sequence) const {
    const Eigen::Vector3d direction = camera_.direction(x, y);
    const Hit hit = scene_.trace(camera_.eye, direction);
    if (hit.face >= 0) {
      Eigen::Vector3f color = surface_.at(hit);
      if (lit_) color = (color * studio_.light(hit, sequence)).cwiseMin(1.0f);
      return {color, 1.0f};
    }
    if (!options_.ground_shadow || options_.mode == PictureMode::kNormals) return {};
    return {Eigen::Vector3f::Zero(), studio_.floor_shadow(camera_.eye, direction, sequence)};
  }

  const Scene& scene_;
  const PictureOptions& options_;
  const Camera& camera_;
  bool lit_;
  SurfaceColor surface_;
  Studio studio_;
  Eigen::Vector3f background_ = Eigen::Vector3f::Zero();
};

}  // namespace

namespace {

std::vector<bool> weighted_joints(const SkinWeights& weights, std::size_t joints) {
  std::vector<bool> result(joints, false);
  for (const Influence& influence : weights.influences) {
    if (influence.joint >= 0 && static_cast<std::size_t>(influence.joint) < joints && influence.weight > 0.0f) {
      result[static_cast<std::size_t>(influence.joint)] = true;
    }
  }
  return result;
}

void draw_skeleton(io::Image& image, const Camera& camera, const Asset& asset, const PictureOptions& options) {
  const std::vector<Eigen::Vector3d> joints = options.joints ? *options.joints : asset.skeleton.positions();
  std::vector<bool> shown;
  if (options.only_weighted_joints) {
    shown = weighted_joints(options.weights ? *options.weights : asset.skin, joints.size());
  }
  draw_skeleton(image, camera, joints, options.parents ? *options.parents : asset.skeleton.parents,
                options.skeleton_style, shown);
}

}  // namespace

Camera picture_camera(const Scene& scene, const PictureOptions& options) {
  return orbit_camera(options.view, scene.vertices(), options.width, options.height);
}

io::Image render(const Scene& scene, const PictureOptions& options) {
  check(options);
  const Camera camera = picture_camera(scene, options);
  const Painter painter(scene, options, camera);
  io::Image image(options.width, options.height);
  parallel_for(static_cast<std::size_t>(options.height), [&](std::size_t y) {
    for (int x = 0; x < options.width; ++x) painter.paint(image, x, static_cast<int>(y));
  });
  if (options.skeleton) draw_skeleton(image, camera, scene.asset(), options);
  return image;
}

io::Image render(const Asset& asset, const PictureOptions& options) {
  check(options);
  return render(Scene(asset, options.vertices), options);
}

void set_pose(PictureOptions& options, const Asset& asset, const Pose& pose) {
  const std::vector<Eigen::Matrix4d> world = forward_kinematics(asset.skeleton.parents, pose);
  options.vertices = skin_vertices(asset, world);
  options.joints.emplace();
  for (const Eigen::Matrix4d& matrix : world) options.joints->push_back(matrix.topRightCorner<3, 1>());
}

}  // namespace anigen::raytrace
