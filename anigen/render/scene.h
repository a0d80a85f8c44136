#pragma once
#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/rigged_asset.h"

namespace anigen::render {

/// A pinhole camera in the world frame (Z up). Pixel (0, 0) is the top left; x runs right, y down; the centre of
/// pixel (i, j) is (i + 0.5, j + 0.5).
struct Camera {
  Eigen::Vector3d eye = Eigen::Vector3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::UnitX();
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
  Eigen::Vector3d forward = Eigen::Vector3d::UnitY();  ///< right × up points back at the viewer
  double tangent = 0.5;                                ///< of half the vertical field of view
  int width = 1, height = 1;

  /// Direction of the ray through a point of the picture, of such a length that its part along `forward` is 1: what it
  /// meets at distance t has depth t.
  Eigen::Vector3d ray(double x, double y) const;
  /// As above, with unit length.
  Eigen::Vector3d direction(double x, double y) const { return ray(x, y).normalized(); }
  /// Picture x, y and the depth along `forward`; x and y mean nothing where depth ≤ 0.
  Eigen::Vector3d project(const Eigen::Vector3d& point) const;
};

/// A view on a circle around an object. Yaw 0 looks at the front of a glTF asset (from −Y); positive yaw moves the
/// camera counter-clockwise seen from above, positive pitch up.
struct Orbit {
  double yaw_degrees = 30.0;
  double pitch_degrees = 15.0;  ///< in [-90, 90]
  double fov_degrees = 30.0;    ///< vertical, in [1, 150]
  double margin = 1.1;          ///< > 1 leaves a border around the object
  /// Points to look at and fit. Without it, all vertices, as large and as central in the picture as they go. Give the
  /// box of a whole animation to keep the camera still: the eye then turns around the centre of that box.
  std::optional<Box> fit;
  std::optional<double> distance;  ///< from the centre of the box to the eye, which then looks at that centre
};

/// @param points what must be visible unless orbit.fit says otherwise; empty: a unit cube around the origin
/// @throws InputError naming the option that is out of range
Camera orbit_camera(const Orbit& orbit, const std::vector<Eigen::Vector3f>& points, int width, int height);

/// The smallest distance from the centre of the box at which everything is visible while the eye looks at that centre:
/// what turntables need, where a camera that follows the outline would make the object sway.
double centred_distance(const Orbit& orbit, const std::vector<Eigen::Vector3f>& points, int width, int height);

/// IEC 61966-2-1, both directions, for values in [0, 1].
inline float srgb_to_linear(float value) {
  return value <= 0.04045f ? value / 12.92f : std::pow((value + 0.055f) / 1.055f, 2.4f);
}

inline float linear_to_srgb(float value) {
  value = std::clamp(value, 0.0f, 1.0f);
  return value <= 0.0031308f ? 12.92f * value : 1.055f * std::pow(value, 1.0f / 2.4f) - 0.055f;
}

/// The samples of one pixel: colour times alpha, linear, and alpha.
struct PixelSum {
  Eigen::Vector3f color = Eigen::Vector3f::Zero();
  float alpha = 0.0f;

  /// @param premultiplied colour times alpha
  void add(const Eigen::Vector3f& premultiplied, float opacity) {
    color += premultiplied;
    alpha += opacity;
  }

  PixelSum scaled(float factor) const { return {factor * color, std::min(1.0f, factor * alpha)}; }

  /// Over an opaque background.
  PixelSum over(const Eigen::Vector3f& background) const { return {color + (1.0f - alpha) * background, 1.0f}; }

  /// As RGBA with straight alpha, [4]. @param srgb encode the colour; false: store the numbers as they are
  void store_straight(std::uint8_t* pixel, bool srgb) const {
    for (Eigen::Index c = 0; c < 3; ++c) {
      const float value = alpha > 0.0f ? color[c] / alpha : 0.0f;
      const float shown = srgb ? linear_to_srgb(value) : std::clamp(value, 0.0f, 1.0f);
      pixel[c] = static_cast<std::uint8_t>(std::lround(255.0f * shown));
    }
    pixel[3] = static_cast<std::uint8_t>(std::lround(255.0f * alpha));
  }
};

/// Hit of a ray on the mesh.
struct Hit {
  std::int32_t face = -1;  ///< -1: nothing was hit
  double distance = 0.0;   ///< along the direction, in its length
  Eigen::Vector3f barycentric = Eigen::Vector3f::Zero();
  Eigen::Vector3f normal = Eigen::Vector3f::UnitZ();       ///< smooth, unit length, turned towards the viewer
  Eigen::Vector3f flat_normal = Eigen::Vector3f::UnitZ();  ///< of the face, turned towards the viewer
  bool front = true;                                       ///< the face's counter-clockwise side was hit
};

/// An asset's mesh ready for rays: set up once per pose, trace many times, from any thread. Double sided.
class Scene {
 public:
  /// @param asset must outlive the scene
  /// @param posed vertex positions to use in place of the asset's, [V]; normals follow
  /// @throws InputError when an array's length, an index or a number in the mesh is wrong
  explicit Scene(const Asset& asset, const std::optional<std::vector<Eigen::Vector3f>>& posed = std::nullopt);
  ~Scene();
  Scene(Scene&&) noexcept;
  Scene& operator=(Scene&&) noexcept;

  /// @param nearest distance from which on the surface counts
  Hit trace(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, double nearest = 0.0) const;

  /// Rays of neighbouring pixels, which the tree takes together about three times as fast as one by one.
  static constexpr std::size_t kBundle = 16;
  /// As trace() for directions of any length but zero; Hit::distance counts in that length.
  std::array<Hit, kBundle> trace(const Eigen::Vector3d& origin,
                                 const std::array<Eigen::Vector3f, kBundle>& directions) const;

  /// True when anything lies between the origin and `distance` along the unit direction.
  bool occluded(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction, float distance) const;

  /// A point near the hit from which shadow rays start: lifted to the smooth surface that the vertex normals imply,
  /// so that coarse meshes get no faceted shadow edges (Hanika, Ray Tracing Gems II, chapter 4).
  Eigen::Vector3f shadow_origin(const Hit& hit) const;

  const Asset& asset() const;
  const std::vector<Eigen::Vector3f>& vertices() const;
  const Box& box() const;  ///< empty for a mesh without faces
  float epsilon() const;   ///< how far off the surface secondary rays start

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace anigen::render
