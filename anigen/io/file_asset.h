#pragma once
#include <Eigen/Core>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/io/gltf/gltf.h"

namespace anigen::io {

/// An asset as writers of other formats than glTF put it down, all numbers in the file's axes (Y up): turned mesh, bind
/// pose, rest pose and animations; normals of unit length; at most
/// options.influences joints per vertex; without animations unless options say so, and of those without channels that
/// have no keys or that a later one for the same property replaces.
/// @throws InputError as write_gltf() does: validate() finds something wrong, or a mesh has no faces
Asset file_asset(const std::string& file, const Asset& asset, const ExportOptions& options);

/// Turns a rig: bind pose, rest pose and clips. @param rotation proper
void turn_rig(const Eigen::Matrix3d& rotation, Skeleton& skeleton, std::vector<Animation>& animations);

/// Divides the world scale of every joint by a number, at all times. Nothing moves: not the joints, and not what hangs
/// on them, since the bind pose is divided too.
/// @param scales [J], positive
void divide_joint_scales(const std::vector<double>& scales, Asset& asset);

/// Takes uniform scales that no clip changes out of the joints (divide_joint_scales()), for USD, which has 16 bits for
/// scales that a clip may change.
void remove_constant_scales(Asset& asset);

/// Takes the scales of the bind pose out of the joints (divide_joint_scales()): of uneven ones their mean. Blender's
/// importer of FBX drops these scales, so that joints below them would stand elsewhere.
void remove_bind_scales(Asset& asset);

/// The name, or with a number behind it the first that is not among `taken`.
std::string unused_name(const std::string& wanted, const std::vector<std::string>& taken);

/// The name with what no file name may have, or what would leave a folder, replaced by '_'; never empty.
std::string file_stem(const std::string& name);

/// Material indices that faces use, in order; -1 stands for none. At least one where there are faces.
std::vector<int> used_materials(const Mesh& mesh);

/// Materials of an asset where -1 stands for none: a plain white one called "default".
Material material_or_default(const Asset& asset, int material);

/// The image that a material shows, where the mesh has the uvs that it needs, else null.
const EncodedImage* image_of(const Asset& asset, const Material& material);

/// ".png" or ".jpg", by the first bytes. @throws InputError when it is neither PNG nor JPEG
std::string image_extension(const EncodedImage& image, const std::string& file);

}  // namespace anigen::io
