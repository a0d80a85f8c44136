#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/asset/skeleton.h"
#include "anigen/asset/skin_weights.h"
#include "anigen/core/config.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/gltf/primitive.h"

namespace anigen::io {

/// The proper rotation from the project's world (Z up) to the file's (Y up). Its entries are exactly -1, 0 or 1,
/// so positions and normals turn without rounding.
Eigen::Matrix3d axis_rotation(ExportAxes axes);

/// A skeleton whose joints have these positions and, in a file with these axes, no rotation: bind pose and rest pose
/// are translations alone, as the published exporter writes them (docs/reference/flows.md, 5.9). For skeletons without
/// orientations of their own, such as generated ones, which would otherwise stand in the file with their root turned
/// from Z up to Y up. Rest pose = bind pose.
Skeleton unrotated_in_file(const Skeleton& skeleton, ExportAxes axes);

/// True for .glb and .vrm, false for .gltf. @throws InputError for another extension
bool is_binary_extension(const std::filesystem::path& path);

/// The node of a joint: name, translation, rotation, scale.
Json joint_node(const std::string& name, const Transform& local);

/// JOINTS_n and WEIGHTS_n (glTF 2.0, section 3.7.3.3) for as many sets of four as the rows need, at least one, with at
/// most `influences` joints per row. Sums of a row are as near to 1 as Khronos' validator demands. Unused slots hold
/// joint 0 with weight 0.
std::vector<gltf_import::InfluenceSet> influence_sets(const SkinWeights& skin, std::size_t influences);

/// Refuses what no writer of rigged assets takes.
/// @throws InputError when validate() finds something wrong with the asset, or faces, skeleton or weights are missing
/// that options.require_rig asks for
void refuse_unsound(const std::string& file, const Asset& asset, const ExportOptions& options);

/// Up to this many joints the indices in JOINTS_n are 8-bit, beyond 16-bit.
inline constexpr std::size_t kMostJointsInBytes = 255;
/// Joints that a skin may have.
inline constexpr std::size_t kMostSkinJoints = 65536;

}  // namespace anigen::io
