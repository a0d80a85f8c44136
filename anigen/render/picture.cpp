#include "anigen/render/picture.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"
#include "anigen/geometry/bones.h"
#include "anigen/render/shading.h"
#include "anigen/render/surface_color.h"

namespace anigen::render {

namespace {

const Eigen::Vector3f kUnweighted(0.5f, 0.5f, 0.5f);

Eigen::Vector3f oklch_to_linear(float lightness, float chroma, float hue) {
  const float a = chroma * std::cos(hue), b = chroma * std::sin(hue);
  const float l = lightness + 0.3963377774f * a + 0.2158037573f * b;
  const float m = lightness - 0.1055613458f * a - 0.0638541728f * b;
  const float s = lightness - 0.0894841775f * a - 1.2914855480f * b;
  const float l3 = l * l * l, m3 = m * m * m, s3 = s * s * s;
  return {4.0767416621f * l3 - 3.3077115913f * m3 + 0.2309699292f * s3,
          -1.2684380046f * l3 + 2.6097574011f * m3 - 0.3413193965f * s3,
          -0.0041960863f * l3 - 0.7034186147f * m3 + 1.7076147010f * s3};
}

/// One capsule of changing radius in the picture; a dot when both ends coincide.
struct Capsule {
  Eigen::Vector2d from, to;
  double radius_from, radius_to;
  double depth;  ///< of the middle, for the order of drawing
  Eigen::Vector3f color;
};

/// Share of the pixel around (x, y) covered by the capsule grown by `grow`.
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

/// -1 when there is none. Bounded, since the parents of a broken skeleton may run in a circle.
int shown_ancestor(const std::vector<int>& parents, const std::vector<bool>& shown, std::size_t joint) {
  int above = parents[joint];
  for (std::size_t step = 0; above >= 0 && step < parents.size(); ++step) {
    if (shown.empty() || shown[at(above)]) return above;
    above = parents[at(above)];
  }
  return -1;
}

constexpr int kOcclusionRaysPerPixel = 24;
constexpr int kLargestPicture = 16384, kMostPixelSamples = 16;

void check_options(const PictureOptions& options) {
  require_between(options.width, 1, kLargestPicture, "width");
  require_between(options.height, 1, kLargestPicture, "height");
  require_between(options.samples_per_axis, 1, kMostPixelSamples, "samples_per_axis");
  if (options.background && !options.background->allFinite())
    throw InputError("", "background", "the colour is not finite");
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

std::vector<bool> weighted_joints(const SkinWeights& weights, std::size_t joints) {
  std::vector<bool> result(joints, false);
  for (const Influence& influence : weights.influences) {
    if (influence.joint >= 0 && static_cast<std::size_t>(influence.joint) < joints && influence.weight > 0.0f)
      result[at(influence.joint)] = true;
  }
  return result;
}

void draw_skeleton(io::Image& image, const Camera& camera, const Asset& asset, const PictureOptions& options) {
  const std::vector<Eigen::Vector3d> joints = options.joints ? *options.joints : asset.skeleton.positions();
  std::vector<bool> shown;
  if (options.only_weighted_joints)
    shown = weighted_joints(options.weights ? *options.weights : asset.skin, joints.size());
  draw_skeleton(image, camera, joints, options.parents ? *options.parents : asset.skeleton.parents,
                options.skeleton_style, shown);
}

/// `vector` turned by the smallest rotation that takes unit `from` to unit `to` (Rodrigues' formula without angles).
Eigen::Vector3f turned(const Eigen::Vector3f& vector, const Eigen::Vector3f& from, const Eigen::Vector3f& to) {
  const Eigen::Vector3f axis = from.cross(to);  // length: the sine
  const float cosine = from.dot(to);
  if (cosine < -0.9999f) return -vector;  // half a turn about an axis that is not determined
  return cosine * vector + axis.cross(vector) + axis.dot(vector) / (1.0f + cosine) * axis;
}

}  // namespace

Eigen::Vector3f joint_color(int joint) {
  constexpr double kGolden = 0.61803398874989485, kTwoPi = 6.28318530717958648;
  constexpr std::array<float, 3> kLightness{0.72f, 0.62f, 0.82f};
  const int index = std::max(joint, 0);
  const auto hue = static_cast<float>(kTwoPi * std::fmod(0.12 + kGolden * index, 1.0));
  const float lightness = kLightness[static_cast<std::size_t>(index) % kLightness.size()];
  // As colourful as the screen can show at this lightness and hue, up to a limit.
  Eigen::Vector3f linear = Eigen::Vector3f::Zero();
  for (float chroma = 0.18f; chroma > 0.02f; chroma -= 0.01f) {
    linear = oklch_to_linear(lightness, chroma, hue);
    if (linear.minCoeff() >= 0.0f && linear.maxCoeff() <= 1.0f) break;
  }
  return linear.cwiseMax(0.0f).unaryExpr([](float value) { return linear_to_srgb(value); });
}

Eigen::Vector3f heat_color(float value) {
  static const std::array<Eigen::Vector3f, 5> kStops{
      Eigen::Vector3f(0.16f, 0.18f, 0.42f), Eigen::Vector3f(0.13f, 0.48f, 0.60f), Eigen::Vector3f(0.45f, 0.75f, 0.45f),
      Eigen::Vector3f(0.98f, 0.85f, 0.30f), Eigen::Vector3f(0.86f, 0.18f, 0.14f)};
  const float at = std::clamp(std::isfinite(value) ? value : 0.0f, 0.0f, 1.0f) * (kStops.size() - 1);
  const std::size_t stop = std::min(static_cast<std::size_t>(at), kStops.size() - 2);
  const float fraction = at - static_cast<float>(stop);
  return (1.0f - fraction) * kStops[stop] + fraction * kStops[stop + 1];
}

std::vector<Eigen::Vector3f> weight_colors(const SkinWeights& weights) {
  std::vector<Eigen::Vector3f> colors(weights.rows(), kUnweighted);
  for (std::size_t v = 0; v < colors.size(); ++v) {
    if (weights.row_size(v) == 0) continue;
    colors[v].setZero();
    for (std::size_t i = 0; i < weights.row_size(v); ++i)
      colors[v] += weights.row(v)[i].weight * joint_color(weights.row(v)[i].joint);
  }
  return colors;
}

std::vector<Eigen::Vector3f> heat_colors(const SkinWeights& weights, const std::vector<int>& joints) {
  std::vector<Eigen::Vector3f> colors(weights.rows());
  for (std::size_t v = 0; v < colors.size(); ++v) {
    float sum = 0.0f;
    for (std::size_t i = 0; i < weights.row_size(v); ++i) {
      const Influence& influence = weights.row(v)[i];
      if (std::find(joints.begin(), joints.end(), influence.joint) != joints.end()) sum += influence.weight;
    }
    colors[v] = heat_color(sum);
  }
  return colors;
}

void draw_skeleton(io::Image& image, const Camera& camera, const std::vector<Eigen::Vector3d>& positions,
                   const std::vector<int>& parents, const OverlayStyle& style, const std::vector<bool>& shown) {
  geometry::check_joints(positions, parents);
  if (!shown.empty() && shown.size() != positions.size())
    throw InputError("", "shown", "must have one entry per joint");
  if (!(style.thickness > 0.0 && style.thickness <= 100.0))
    throw InputError("", "thickness", "must be above 0 and at most 100");
  if (!style.bone.allFinite() || !style.joint.allFinite() || !style.outline.allFinite())
    throw InputError("", "skeleton_style", "a colour is not finite");
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
    const Eigen::Vector2d place = projected[j].head<2>();
    const Eigen::Vector3f own = joint_color(static_cast<int>(j));
    dots.push_back({place, place, 0.9 * size, 0.9 * size, projected[j].z(), style.joint});
    const int above = shown_ancestor(parents, shown, j);
    if (above < 0 || !visible[at(above)]) continue;
    const std::size_t parent = at(above);
    bones.push_back({projected[parent].head<2>(), place, 0.85 * size, 0.35 * size,
                     0.5 * (projected[j].z() + projected[parent].z()), style.color_by_joint ? own : style.bone});
  }
  const auto farther = [](const Capsule& a, const Capsule& b) { return a.depth > b.depth; };
  std::stable_sort(bones.begin(), bones.end(), farther);
  std::stable_sort(dots.begin(), dots.end(), farther);
  for (const Capsule& bone : bones) draw(image, bone, style.outline, rim);
  for (const Capsule& dot : dots) draw(image, dot, style.outline, rim);
}

Camera picture_camera(const Scene& scene, const PictureOptions& options) {
  return orbit_camera(options.view, scene.vertices(), options.width, options.height);
}

io::Image render(const Scene& scene, const PictureOptions& options) {
  check_options(options);
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
  check_options(options);
  return render(Scene(asset, options.vertices), options);
}

void set_pose(PictureOptions& options, const Asset& asset, const Pose& pose) {
  const std::vector<Eigen::Matrix4d> world = forward_kinematics(asset.skeleton.parents, pose);
  options.vertices = skin_vertices(asset, world);
  options.joints.emplace();
  for (const Eigen::Matrix4d& matrix : world) options.joints->push_back(matrix.topRightCorner<3, 1>());
}

std::vector<Eigen::Vector3f> posed_normals(const Mesh& mesh, const std::vector<Eigen::Vector3f>& vertices) {
  const std::vector<Eigen::Vector3f> after = vertex_normals(vertices, mesh.faces);
  if (mesh.normals.empty()) return after;
  const std::vector<Eigen::Vector3f> before = vertex_normals(mesh.vertices, mesh.faces);
  std::vector<Eigen::Vector3f> normals(vertices.size());
  for (std::size_t v = 0; v < normals.size(); ++v) normals[v] = turned(mesh.normals[v], before[v], after[v]);
  return normals;
}

std::vector<io::Image> turntable(const Asset& asset, const PictureOptions& options, int views) {
  require_between(views, 1, 3600, "views");
  const Scene scene(asset, options.vertices);
  std::vector<PictureOptions> turns(static_cast<std::size_t>(views), options);
  double distance = 0.0;
  for (int i = 0; i < views; ++i) {
    Orbit& view = turns[at(i)].view;
    view.yaw_degrees += 360.0 * i / views;
    distance = std::max(distance, centred_distance(view, scene.vertices(), options.width, options.height));
  }
  std::vector<io::Image> pictures;
  for (PictureOptions& turn : turns) {
    turn.view.distance = distance;
    pictures.push_back(render(scene, turn));
  }
  return pictures;
}

}  // namespace anigen::render
