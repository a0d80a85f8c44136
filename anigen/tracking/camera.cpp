#include "anigen/tracking/camera.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/raster/mesh_renderer.h"
#include "anigen/tracking/objective.h"

namespace anigen::tracking {

namespace {

constexpr double kDegree = 3.14159265358979323846 / 180.0;
constexpr double kFittedRadius = 2.6;  // a sphere of diameter √3 fits a field of view of 40° from there
constexpr double kFrontYaw = -90.0;    // of ViewCamera, in degrees: the eye on −Y

using Numbers = std::array<double, 5>;  // yaw, pitch (degrees), log of the focal length, centre x, y

PinholeCamera camera_of(const Numbers& x) {
  render::ViewCamera view;
  view.yaw = (kFrontYaw + x[0]) * kDegree;
  view.pitch = x[1] * kDegree;
  view.radius = kFittedRadius;
  view.fov = render::kFeatureFov;
  PinholeCamera camera;
  camera.world_to_camera = render::extrinsics_of(render::camera_to_world(view));
  camera.focal_x = camera.focal_y = std::exp(x[2]);
  camera.center_x = x[3];
  camera.center_y = x[4];
  return camera;
}

struct PlaceBox {
  double x0, x1, y0, y1;
};

PlaceBox box_of_places(const Tensor& places) {  // [N, 2]
  const Tensor low = places.amin(0), high = places.amax(0);
  return {low[0].item<double>(), high[0].item<double>(), low[1].item<double>(), high[1].item<double>()};
}

/// Bind pose under a camera against a frame.
class BindView {
 public:
  BindView(const RigTensors& rig, const FrameLevel& frame) : rig_(rig), frame_(frame) {
    const PosedRig bind =
        posed(rig, torch::zeros({1, rig.joints(), 3}, torch::kFloat64), torch::zeros({1, 3}, torch::kFloat64));
    vertices_ = bind.vertices[0];
    normals_ = bind.normals[0];
    const Tensor inside = (frame.alpha >= 0.5).nonzero().to(torch::kFloat64);  // rows, columns
    target_ = box_of_places((inside.flip(1) + 0.5) / static_cast<double>(frame.size()));
  }

  /// Focal length and centre that lay the box of the bind pose upon the frame's.
  Numbers fitted(double yaw, double pitch) const {
    Numbers x{yaw, pitch, 0.0, 0.0, 0.0};
    const PlaceBox box = box_of_places(picture_places(clip_positions(vertices_, camera_of(x))));
    const auto ratio = [](double wanted, double found) {
      return std::log(std::max(wanted, 1e-3) / std::max(found, 1e-6));
    };
    x[2] = 0.5 * (ratio(target_.x1 - target_.x0, box.x1 - box.x0) + ratio(target_.y1 - target_.y0, box.y1 - box.y0));
    const double focal = std::exp(x[2]);
    x[3] = 0.5 * (target_.x0 + target_.x1 - focal * (box.x0 + box.x1));
    x[4] = 0.5 * (target_.y0 + target_.y1 - focal * (box.y0 + box.y1));
    return x;
  }

  double overlap(const Numbers& x) const {
    const Tensor clip = clip_positions(vertices_, camera_of(x));
    return overlap_of(render_rig(rig_, clip, normals_, plain_light(), frame_.size()).mask, frame_.alpha);
  }

  double error(const Numbers& x) const {
    for (const double number : x) {
      if (!std::isfinite(number)) return std::numeric_limits<double>::infinity();
    }
    if (std::abs(x[0]) > 120.0 || std::abs(x[1]) > 60.0 || std::abs(x[2]) > 5.0) return 1e3;
    const Tensor clip = clip_positions(vertices_, camera_of(x));
    const Light light = fit_light(rig_, clip, normals_, frame_);
    const Rendering seen = render_rig(rig_, clip, normals_, light, frame_.size());
    const double color =
        (seen.color - frame_.color).square().sum(2).sqrt().sum().item<double>() / std::max(1.0, frame_.area);
    return 1.0 - overlap_of(seen.mask, frame_.alpha) + 0.5 * color;
  }

 private:
  const RigTensors& rig_;
  const FrameLevel& frame_;
  Tensor vertices_, normals_;
  PlaceBox target_{};
};

/// Nelder and Mead 1965 with their coefficients 1, 2, ½, ½.
Numbers simplex_minimum(const std::function<double(const Numbers&)>& error, const Numbers& start, const Numbers& steps,
                        int evaluations) {
  struct Corner {
    Numbers at;
    double error;
  };
  std::vector<Corner> corners{{start, error(start)}};
  for (std::size_t k = 0; k < start.size(); ++k) {
    Numbers moved = start;
    moved[k] += steps[k];
    corners.push_back({moved, error(moved)});
  }
  const auto between = [](const Numbers& from, const Numbers& to, double t) {
    Numbers x{};
    for (std::size_t k = 0; k < x.size(); ++k) x[k] = from[k] + t * (to[k] - from[k]);
    return x;
  };
  const auto better = [](const Corner& a, const Corner& b) { return a.error < b.error; };
  for (int used = 0; used < evaluations;) {
    std::stable_sort(corners.begin(), corners.end(), better);
    Numbers middle{};
    for (std::size_t i = 0; i + 1 < corners.size(); ++i) {
      for (std::size_t k = 0; k < middle.size(); ++k)
        middle[k] += corners[i].at[k] / static_cast<double>(corners.size() - 1);
    }
    Corner& worst = corners.back();
    const auto tried = [&](double t) {
      ++used;
      const Numbers x = between(middle, worst.at, t);
      return Corner{x, error(x)};
    };
    const Corner reflected = tried(-1.0);
    if (better(reflected, corners.front())) {
      const Corner expanded = tried(-2.0);
      worst = better(expanded, reflected) ? expanded : reflected;
    } else if (better(reflected, corners[corners.size() - 2])) {
      worst = reflected;
    } else {
      const Corner contracted = tried(better(reflected, worst) ? -0.5 : 0.5);
      if (better(contracted, worst)) {
        worst = contracted;
      } else {
        for (std::size_t i = 1; i < corners.size(); ++i, ++used) {
          corners[i].at = between(corners.front().at, corners[i].at, 0.5);
          corners[i].error = error(corners[i].at);
        }
      }
    }
  }
  return std::min_element(corners.begin(), corners.end(), better)->at;
}

}  // namespace

PinholeCamera pinhole(const render::Frame& frame) {
  const Eigen::Matrix3d intrinsics = render::intrinsics(frame);
  PinholeCamera camera;
  camera.world_to_camera = render::extrinsics(frame);
  camera.focal_x = intrinsics(0, 0);
  camera.focal_y = intrinsics(1, 1);
  camera.center_x = intrinsics(0, 2);
  camera.center_y = intrinsics(1, 2);
  return camera;
}

Tensor clip_positions(const Tensor& vertices, const PinholeCamera& camera) {
  const bool finite = camera.world_to_camera.allFinite() && std::isfinite(camera.focal_x) &&
                      std::isfinite(camera.focal_y) && std::isfinite(camera.center_x) && std::isfinite(camera.center_y);
  if (!finite) throw InputError("", "camera", "holds a number that is not finite");
  if (!(camera.focal_x > 0.0 && camera.focal_y > 0.0))
    throw InputError("", "camera", "its focal length is not positive");
  const Tensor extrinsics = torch::empty({4, 4}, torch::kFloat64), projection = torch::zeros({4, 4}, torch::kFloat64);
  Eigen::Map<Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(extrinsics.data_ptr<double>()) = camera.world_to_camera;
  const double distance = std::max(1e-6, camera.world_to_camera.topRightCorner<3, 1>().norm());
  const double near = 0.01 * distance, far = 100.0 * distance;
  double* p = projection.data_ptr<double>();
  p[0] = 2.0 * camera.focal_x;
  p[2] = 2.0 * camera.center_x - 1.0;
  p[5] = 2.0 * camera.focal_y;
  p[6] = 2.0 * camera.center_y - 1.0;
  p[10] = far / (far - near);
  p[11] = near * far / (near - far);
  p[14] = 1.0;
  return raster::to_clip(vertices, extrinsics, projection);
}

Tensor picture_places(const Tensor& clip) {
  // A point behind the camera has no place; it keeps a finite one far outside.
  const Tensor depth = clip.narrow(1, 3, 1).clamp_min(1e-6);
  return 0.5 * (clip.narrow(1, 0, 2) / depth + 1.0);
}

FittedCamera fit_camera(const RigTensors& rig, const FrameLevel& frame) {
  const torch::NoGradGuard no_grad;
  const BindView view(rig, frame);
  Numbers best{};
  double least = std::numeric_limits<double>::infinity();
  for (int yaw = -90; yaw <= 90; yaw += 15) {
    for (const double pitch : {0.0, 10.0, 20.0}) {
      const Numbers x = view.fitted(yaw, pitch);
      const double error = view.error(x);
      if (error >= least) continue;
      least = error;
      best = x;
    }
  }
  const auto error = [&](const Numbers& x) { return view.error(x); };
  best = simplex_minimum(error, best, {6.0, 5.0, 0.05, 0.02, 0.02}, 160);
  return {camera_of(best), best[0], best[1], view.overlap(best)};
}

}  // namespace anigen::tracking
