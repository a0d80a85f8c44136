#pragma once
#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/rigged_asset.h"
#include "anigen/core/random.h"
#include "anigen/io/image_resize.h"

namespace anigen::render {

// Cameras in OpenCV's form: x right, y down, z forward; pictures as uv in [0, 1]², origin top left, so that intrinsics
// do not depend on the resolution. (docs/reference/training.md, 1.1.)

/// World-to-camera [4,4] of a camera-to-world in Blender's form: the inverse after columns 1 and 2 (up, back) have
/// changed sign. @throws InputError when the matrix has no inverse
Eigen::Matrix4d extrinsics_of(const Eigen::Matrix4d& camera_to_world);

/// Normalised intrinsics [3,3] of a field of view (radians) that holds for both axes:
/// fx = fy = 0.5 / tan(fov / 2), cx = cy = 0.5. @throws InputError unless 0 < fov < π
Eigen::Matrix3d intrinsics_of(double fov);

/// (u, v, depth) of a world point, depth along the optical axis. The plain quotient: u and v mean nothing where
/// depth ≤ 0.
Eigen::Vector3d project(const Eigen::Vector3d& point, const Eigen::Matrix4d& extrinsics,
                        const Eigen::Matrix3d& intrinsics);

/// The world point that project() maps to (u, v, depth).
Eigen::Vector3d unproject(const Eigen::Vector3d& uv_depth, const Eigen::Matrix4d& extrinsics,
                          const Eigen::Matrix3d& intrinsics);

/// Clip-space projection [4,4] for OpenCV camera space: z / w is 0 at depth `near` and 1 at `far`, y is not flipped,
/// so row 0 of what is rasterised with it is the top. Entry (1, 2) is 1 − 2 cy as published, which is right only for
/// cy = 0.5. (Parity notes, "Differentiable rasterisation rules".) @throws InputError unless 0 < near < far
Eigen::Matrix4d clip_projection(const Eigen::Matrix3d& intrinsics, double near, double far);

/// uv of all pixel centres, row by row from the top, [height · width].
std::vector<Eigen::Vector2d> image_uv(int width, int height);

/// A camera that looks at the origin with +Z up, from `radius` away. The eye is at
/// radius · (cos yaw cos pitch, sin yaw cos pitch, sin pitch). Angles in radians; `fov` is the full horizontal (and
/// vertical: pictures are square) field of view.
struct ViewCamera {
  double yaw = 0.0, pitch = 0.0, radius = 2.0, fov = 0.0;
};

/// Directions spread evenly over the sphere: yaw and pitch of point i of n of the Hammersley set, shifted by
/// (offset0 / n, offset1). Yaw is not wrapped. (docs/reference/training.md, 1.1.)
/// @param upper remaps the set so that three quarters of it lie in the upper hemisphere, as the published data
/// preparation does; false: the plain set of the published previews
ViewCamera hammersley_view(std::size_t i, std::size_t n, double offset0, double offset1, bool upper);

inline constexpr double kFeatureRadius = 2.0;
inline constexpr double kFeatureFov = 0.69813170079773184;  ///< 40°

/// The cameras of `renders/`, from which features are computed: radius 2, field of view 40°, 75 % of them above.
/// @param offset0,offset1 uniform in [0, 1), drawn once per object @throws InputError when n is 0
std::vector<ViewCamera> feature_views(std::size_t n, double offset0, double offset1);

/// The cameras of `renders_cond/`, which image conditions come from: the same directions with random offsets, fields of
/// view between 10° and 70° and the radius at which the sphere around the unit cube just fills the picture
/// (1 / radius² is uniform). @throws InputError when n is 0
std::vector<ViewCamera> condition_views(std::size_t n, Rng& rng);

/// Ours, for data sets too small to learn what every side looks like: cameras in front of the object, which faces −Y,
/// as people take pictures. Yaw within 60° of the front, one camera in each n-th of that range; pitch from −5° to 30°;
/// field of view 40° and the radius that belongs to it. @throws InputError when n is 0
std::vector<ViewCamera> front_views(std::size_t n, Rng& rng);

/// Camera axes in columns and position: Blender's camera-to-world (looks along −Z, +Y up), [4,4]. Well defined at the
/// poles, too. @throws InputError when a number is not finite, the radius not positive or fov outside (0, π)
Eigen::Matrix4d camera_to_world(const ViewCamera& view);

/// One picture of an object and the camera that took it.
struct Frame {
  std::string file_path;        ///< relative to the folder of transforms.json, such as "000.png"
  double camera_angle_x = 0.0;  ///< field of view in radians, for both axes
  Eigen::Matrix4d camera_to_world = Eigen::Matrix4d::Identity();  ///< Blender's form: looks along −Z, +Y up
};

/// Contents of `renders/<id>/transforms.json` and `renders_cond/<id>/transforms.json` hold (docs/reference/training.md,
/// 1.1).
struct Transforms {
  Box aabb{Eigen::Vector3d::Constant(-0.5), Eigen::Vector3d::Constant(0.5)};  ///< of the normalised frame
  double scale = 1.0;  ///< x → scale · x + offset normalised the source mesh
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();
  std::vector<Frame> frames;
};

/// World-to-camera in OpenCV's form, [4,4].
Eigen::Matrix4d extrinsics(const Frame& frame);
/// Normalised OpenCV intrinsics, [3,3].
Eigen::Matrix3d intrinsics(const Frame& frame);

Frame make_frame(const ViewCamera& view, std::string file_path);

/// Camera of a square part of a picture, without units: a point x of the object, with a = x · right, b = x · up and
/// c = x · back of camera_to_world({yaw, pitch}), lies at
///
///     u = shift_x + scale a / (1 − nearness c),   v = shift_y − scale b / (1 − nearness c)
///
/// in that part, which spans [0, 1]² from its upper left corner. Field of view, distance and place of the part are in
/// scale and shift; a camera has no roll and looks at the origin.
struct PartCamera {
  double yaw = 0.0, pitch = 0.0;  ///< radians
  double scale = 1.0;             ///< part's sides per unit at the origin
  double shift_x = 0.5, shift_y = 0.5;
  double nearness = 0.0;  ///< 1 / distance of the eye from the origin; 0: orthographic
};

/// @param box of pixels of the frame's picture, square but for the pixel that io::condition_box() may cut off
/// @param size of that picture in pixels
PartCamera part_camera(const Frame& frame, const io::PixelBox& box, int size);

/// Frames of a view plan, named 000.png, 001.png, … as published.
Transforms make_transforms(const std::vector<ViewCamera>& views, const Similarity& normalisation);

/// The bytes of transforms.json: the published keys, one frame a line, numbers as short as they can be read back
/// exactly. Equal values give equal bytes.
/// @throws InputError when a value would not be accepted by parse_transforms
std::string format_transforms(const Transforms& transforms);

/// Atomic. @throws InputError as format_transforms
void write_transforms(const std::filesystem::path& path, const Transforms& transforms);

/// Accepts what the published tools write; aabb, scale and offset may be absent, other keys are ignored.
/// @param file only for messages
/// @throws InputError with the JSON pointer when the text is damaged or huge, a value has the wrong type or is not
/// finite, there is no frame or more than 100,000, a matrix is not 4×4 or not a rigid motion, a field of view is
/// outside (0, π), or a file_path is empty, absolute or leaves the folder
Transforms parse_transforms(std::string_view text, const std::string& file);
Transforms read_transforms(const std::filesystem::path& path);

}  // namespace anigen::render
