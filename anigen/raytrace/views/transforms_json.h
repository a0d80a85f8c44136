#pragma once
#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/normalize.h"
#include "anigen/raytrace/views/view_plan.h"

namespace anigen::raytrace {

/// One picture of an object and the camera that took it.
struct Frame {
  std::string file_path;        ///< relative to the folder of transforms.json, such as "000.png"
  double camera_angle_x = 0.0;  ///< field of view in radians, for both axes
  Eigen::Matrix4d camera_to_world = Eigen::Matrix4d::Identity();  ///< Blender's form: looks along −Z, +Y up
};

/// What `renders/<id>/transforms.json` and `renders_cond/<id>/transforms.json` hold (reference training-and-data.md,
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

}  // namespace anigen::raytrace
