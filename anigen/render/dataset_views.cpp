#include "anigen/render/dataset_views.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"
#include "anigen/render/shading.h"
#include "anigen/render/surface_color.h"

namespace anigen::render {

namespace {

constexpr int kTile = 4;  ///< pixels on a side that are traced as one bundle
static_assert(std::size_t{kTile} * kTile == Scene::kBundle, "a bundle has one ray per pixel of a tile");
constexpr int kLargestSize = 16384, kMostSamples = 16, kMostOcclusionRays = 256;

void check(const ViewOptions& options) {
  require_between(options.size, 1, kLargestSize, "size");
  require_between(options.samples_per_axis, 1, kMostSamples, "samples_per_axis");
  require_between(options.occlusion_rays, 0, kMostOcclusionRays, "occlusion_rays");
}

ViewImages blank(const ViewOptions& options) {
  const auto pixels = static_cast<std::size_t>(options.size) * static_cast<std::size_t>(options.size);
  ViewImages images;
  images.size = options.size;
  if (options.color) images.color = io::Image(options.size, options.size, 0);
  if (options.color || options.mean_normal) images.coverage.resize(pixels, 0.0f);
  if (options.mean_normal) images.mean_normal.resize(pixels, Eigen::Vector3f::Zero());
  if (options.geometry) {
    images.depth.resize(pixels, 0.0f);
    images.normal.resize(pixels, Eigen::Vector3f::Zero());
    images.mask.resize(pixels, 0);
  }
  if (options.visibility) {
    images.face.resize(pixels, -1);
    images.barycentric.resize(pixels, Eigen::Vector3f::Zero());
  }
  return images;
}

/// One picture being taken.
class Exposure {
 public:
  Exposure(const Scene& scene, const SurfaceColor& colors, const Cutout& holes, const Camera& camera,
           const ViewOptions& options, ViewImages& images)
      : scene_(scene),
        colors_(colors),
        holes_(holes),
        camera_(camera),
        options_(options),
        images_(images),
        studio_(scene, dataset_lights(), options.occlusion_rays, options.shadows, &holes) {}

  void take_tile(int left, int top) {
    const int n = options_.samples_per_axis;
    const bool centres = options_.geometry || options_.visibility;
    if (options_.color || options_.mean_normal) {
      std::array<PixelSum, Scene::kBundle> colors;
      std::array<Eigen::Vector3f, Scene::kBundle> normals;
      normals.fill(Eigen::Vector3f::Zero());
      for (int s = 0; s < n * n; ++s) {
        const Hits hits = trace(left + (s % n + 0.5) / n, top + (s / n + 0.5) / n);
        shade(hits, s, left, top, colors, normals);
        if (centres && n % 2 == 1 && s == n * n / 2) store_centres(hits, left, top);
      }
      store_averages(left, top, colors, normals);
      if (n % 2 == 1) return;  // the middle sample is the centre
    }
    if (centres) store_centres(trace(left + 0.5, top + 0.5), left, top);
  }

 private:
  using Hits = std::array<Hit, Scene::kBundle>;

  /// Through the same place of all pixels of a tile. Pixels beyond the border are traced, but never stored.
  Hits trace(double x, double y) const {
    std::array<Eigen::Vector3f, Scene::kBundle> directions;
    for (int i = 0; i < kTile * kTile; ++i) directions[at(i)] = camera_.ray(x + i % kTile, y + i / kTile).cast<float>();
    Hits hits = scene_.trace(camera_.eye, directions);
    if (holes_.empty()) return hits;
    for (std::size_t i = 0; i < hits.size(); ++i) {
      if (hits[i].face < 0) continue;
      hits[i] = holes_.behind_holes(camera_.eye, directions[i].cast<double>(), hits[i]);
    }
    return hits;
  }

  void shade(const Hits& hits, int sample, int left, int top, std::array<PixelSum, Scene::kBundle>& colors,
             std::array<Eigen::Vector3f, Scene::kBundle>& normals) const {
    for (std::size_t i = 0; i < hits.size(); ++i) {
      if (hits[i].face < 0) continue;
      if (options_.color) {
        const int x = left + static_cast<int>(i) % kTile, y = top + static_cast<int>(i) / kTile;
        PixelSequence sequence(x, y, sample * (options_.occlusion_rays + 1));
        colors[i].add((colors_.at(hits[i]) * studio_.light(hits[i], sequence)).cwiseMin(1.0f), 1.0f);
      } else {
        colors[i].add(Eigen::Vector3f::Zero(), 1.0f);
      }
      normals[i] += normal(hits[i]);
    }
  }

  const Eigen::Vector3f& normal(const Hit& hit) const { return options_.flat_normals ? hit.flat_normal : hit.normal; }

  void store_averages(int left, int top, const std::array<PixelSum, Scene::kBundle>& colors,
                      const std::array<Eigen::Vector3f, Scene::kBundle>& normals) {
    const int samples = options_.samples_per_axis * options_.samples_per_axis;
    each_pixel(left, top, [&](std::size_t i, std::size_t pixel, int x, int y) {
      const PixelSum mean = colors[i].scaled(1.0f / static_cast<float>(samples));
      if (mean.alpha <= 0.0f) return;
      images_.coverage[pixel] = mean.alpha;
      if (options_.color) mean.store_straight(images_.color.pixel(x, y), true);
      if (options_.mean_normal) images_.mean_normal[pixel] = normals[i].stableNormalized();
    });
  }

  void store_centres(const Hits& hits, int left, int top) {
    each_pixel(left, top, [&](std::size_t i, std::size_t pixel, int, int) {
      const Hit& hit = hits[i];
      if (hit.face < 0) return;
      if (options_.geometry) {
        images_.depth[pixel] = static_cast<float>(hit.distance);
        images_.normal[pixel] = normal(hit);
        images_.mask[pixel] = 1;
      }
      if (options_.visibility) {
        images_.face[pixel] = hit.face;
        images_.barycentric[pixel] = hit.barycentric;
      }
    });
  }

  template <typename Body>
  void each_pixel(int left, int top, const Body& body) const {
    const int right = std::min(left + kTile, options_.size), bottom = std::min(top + kTile, options_.size);
    for (int y = top; y < bottom; ++y) {
      for (int x = left; x < right; ++x) {
        body(static_cast<std::size_t>((y - top) * kTile + x - left),
             static_cast<std::size_t>(y) * static_cast<std::size_t>(options_.size) + static_cast<std::size_t>(x), x, y);
      }
    }
  }

  const Scene& scene_;
  const SurfaceColor& colors_;
  const Cutout& holes_;
  const Camera& camera_;
  const ViewOptions& options_;
  ViewImages& images_;
  Studio studio_;
};

constexpr double kPublishedTurn = 2.0 * 3.1415;

template <typename Channel>
void require(const ViewImages& view, const Channel& channel, const char* name) {
  const auto pixels = static_cast<std::size_t>(view.size) * static_cast<std::size_t>(view.size);
  if (view.size > 0 && channel.size() == pixels) return;
  throw InputError("", name, "the view was rendered without this channel");
}

io::NdArray array3(const std::vector<Eigen::Vector3f>& values, std::int64_t size) {
  std::vector<float> numbers;
  numbers.reserve(3 * values.size());
  for (const Eigen::Vector3f& value : values) numbers.insert(numbers.end(), value.data(), value.data() + 3);
  return io::NdArray::from(numbers, {size, size, 3});
}

}  // namespace

Camera view_camera(const Frame& frame, int size) {
  require_between(size, 1, kLargestSize, "size");
  if (!frame.camera_to_world.allFinite()) throw InputError("", "transform_matrix", "the camera's matrix is not finite");
  if (!(frame.camera_angle_x > 0.0 && frame.camera_angle_x < kPi))
    throw InputError("", "camera_angle_x", "the field of view must be between 0 and pi");
  Camera camera;
  camera.right = frame.camera_to_world.col(0).head<3>();
  camera.up = frame.camera_to_world.col(1).head<3>();
  camera.forward = -frame.camera_to_world.col(2).head<3>();
  camera.eye = frame.camera_to_world.col(3).head<3>();
  camera.tangent = std::tan(0.5 * frame.camera_angle_x);
  camera.width = camera.height = size;
  return camera;
}

struct ViewRenderer::Implementation {
  Implementation(const Scene& s, float alpha_cutoff) : scene(s), colors(s, {}), holes(s, colors, alpha_cutoff) {}

  const Scene& scene;
  SurfaceColor colors;
  Cutout holes;
};

ViewRenderer::ViewRenderer(const Scene& scene, float alpha_cutoff) {
  require_between(alpha_cutoff, 0, 1, "alpha_cutoff");
  implementation_ = std::make_unique<Implementation>(scene, alpha_cutoff);
}

ViewRenderer::~ViewRenderer() = default;
ViewRenderer::ViewRenderer(ViewRenderer&&) noexcept = default;
ViewRenderer& ViewRenderer::operator=(ViewRenderer&&) noexcept = default;

ViewImages ViewRenderer::render(const Frame& frame, const ViewOptions& options) const {
  check(options);
  const Camera camera = view_camera(frame, options.size);
  ViewImages images = blank(options);
  Exposure exposure(implementation_->scene, implementation_->colors, implementation_->holes, camera, options, images);
  const auto tiles = static_cast<std::size_t>((options.size + kTile - 1) / kTile);
  parallel_for(tiles, [&](std::size_t row) {
    for (int left = 0; left < options.size; left += kTile) exposure.take_tile(left, static_cast<int>(row) * kTile);
  });
  return images;
}

ViewImages render_view(const Scene& scene, const Frame& frame, const ViewOptions& options) {
  return ViewRenderer(scene).render(frame, options);
}

ViewCamera from_preview(const ViewCamera& preview) {
  ViewCamera view = preview;
  view.yaw = 0.5 * kPi - preview.yaw;
  return view;
}

std::vector<ViewCamera> preview_turn(std::size_t frames) {
  if (frames == 0) throw InputError("", "frames", "there must be at least one frame");
  std::vector<ViewCamera> views(frames);
  for (std::size_t i = 0; i < frames; ++i) {
    const double last = frames > 1 ? static_cast<double>(frames - 1) : 1.0;
    const double yaw = kPublishedTurn * static_cast<double>(i) / last;
    views[i] = {yaw, 0.25 + 0.5 * std::sin(yaw), kFeatureRadius, kFeatureFov};
  }
  return views;
}

std::vector<ViewCamera> snapshot_views() {
  std::vector<ViewCamera> views;
  for (int side = 0; side < 4; ++side) {
    views.push_back({(90.0 * side - 16.0) * kPi / 180.0, 20.0 * kPi / 180.0, kFeatureRadius, kFeatureFov});
  }
  return views;
}

io::Image encode_world_normals(const ViewImages& view) {
  require(view, view.normal, "normal");
  require(view, view.mask, "mask");
  io::Image image(view.size, view.size, 0);
  for (std::size_t i = 0; i < view.normal.size(); ++i) {
    if (view.mask[i] == 0) continue;
    for (std::size_t c = 0; c < 3; ++c) {
      const float value = 127.5f * (view.normal[i][static_cast<Eigen::Index>(c)] + 1.0f);
      image.rgba[4 * i + c] = static_cast<std::uint8_t>(std::lround(std::clamp(value, 0.0f, 255.0f)));
    }
    image.rgba[4 * i + 3] = 255;
  }
  return image;
}

io::Image encode_condition_normals(const ViewImages& view, const Frame& frame) {
  require(view, view.mean_normal, "mean_normal");
  require(view, view.coverage, "coverage");
  const Eigen::Matrix3f to_camera = frame.camera_to_world.topLeftCorner<3, 3>().transpose().cast<float>();
  io::Image image(view.size, view.size, 0);
  for (std::size_t i = 0; i < view.mean_normal.size(); ++i) {
    if (view.coverage[i] <= 0.0f) continue;
    const Eigen::Vector3f normal = to_camera * view.mean_normal[i];
    for (std::size_t c = 0; c < 3; ++c) {
      // Truncated as published; the small term keeps a length one bit below 1 from falling a whole grey level.
      const float value = 127.5f * (normal[static_cast<Eigen::Index>(c)] + 1.0f) + 1e-3f;
      image.rgba[4 * i + c] = static_cast<std::uint8_t>(std::clamp(value, 0.0f, 255.0f));
    }
    image.rgba[4 * i + 3] = static_cast<std::uint8_t>(std::lround(255.0f * view.coverage[i]));
  }
  return image;
}

std::vector<std::uint8_t> encode_depth_png(const ViewImages& view) {
  require(view, view.depth, "depth");
  io::Grey16 grey;
  grey.width = grey.height = view.size;
  grey.values.resize(view.depth.size());
  for (std::size_t i = 0; i < grey.values.size(); ++i) {
    const double steps = std::round(kDepthUnits * static_cast<double>(view.depth[i]));
    if (!(steps >= 0.0 && steps <= 65535.0))
      throw InputError("", "depth", "a depth of " + std::to_string(view.depth[i]) + " does not fit the 16-bit picture");
    grey.values[i] = static_cast<std::uint16_t>(view.depth[i] > 0.0f ? std::max(1.0, steps) : 0.0);
  }
  return io::encode_png16(grey);
}

std::vector<float> decode_depth_png(const std::vector<std::uint8_t>& bytes, const std::string& name_for_errors,
                                    int& width, int& height) {
  const io::Grey16 picture = io::decode_grey16(bytes, name_for_errors);
  width = picture.width;
  height = picture.height;
  std::vector<float> depth;
  depth.reserve(picture.values.size());
  for (const std::uint16_t value : picture.values) depth.push_back(static_cast<float>(value / kDepthUnits));
  return depth;
}

io::NamedArrays view_arrays(const ViewImages& view) {
  const std::int64_t size = view.size;
  io::NamedArrays arrays;
  if (!view.depth.empty()) arrays.emplace_back("depth", io::NdArray::from(view.depth, {size, size}));
  if (!view.normal.empty()) arrays.emplace_back("normal", array3(view.normal, size));
  if (!view.mask.empty()) arrays.emplace_back("mask", io::NdArray::from(view.mask, {size, size}));
  if (!view.face.empty()) arrays.emplace_back("face", io::NdArray::from(view.face, {size, size}));
  if (!view.barycentric.empty()) arrays.emplace_back("barycentric", array3(view.barycentric, size));
  return arrays;
}

}  // namespace anigen::render
