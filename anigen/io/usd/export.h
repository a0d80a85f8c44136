#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/usd/package.h"
#include "anigen/io/usd/text.h"

namespace anigen::io {

/// Writes a USD scene as text (.usda) or as a package (.usdz) of that text and the textures, atomically. The same asset
/// gives the same bytes. A .usda's textures stand in a folder "<name>_textures" beside it.
///
/// Y up, metres; a SkelRoot with one Mesh, one Skeleton, a SkelAnimation per clip, of which the first is bound, and
/// UsdPreviewSurface materials. Prims and joints have identifiers made from their names; the names themselves stand in
/// customData and in the skeleton's jointNames.
///
/// Limits of the format: scales of animated poses have 16 bits, so uniform scales that never change are
/// taken out of the joints first (remove_constant_scales()); steps are short ramps (kStepRamp); where a mesh has vertex
/// colours and no texture, they are multiplied with the material's colour.
/// @throws InputError as write_gltf() does, and for another extension; NotSupportedError as package_bytes()
void write_usd(const std::filesystem::path& path, const Asset& asset, const ExportOptions& options = {});

}  // namespace anigen::io

namespace anigen::io::usd_export {

/// Text of a scene and the textures that it names.
struct Stage {
  std::string text;
  std::vector<PackageFile> textures;
};

/// @param asset in the file's axes, as file_asset() makes it, without constant scales @param folder of the textures, as
/// the text names it
/// @throws InputError for an image that is neither PNG nor JPEG
Stage stage_of(const Asset& asset, const std::string& folder, const std::string& file);

/// Paths of the joints, such as "hips/spine/head", each part an identifier that no other joint has.
std::vector<std::string> joint_paths(const Skeleton& skeleton);

/// Appends the prim Skeleton, and a prim SkelAnimation for each clip. @param root path of the prim around them
void add_skeleton(const Asset& asset, const std::string& root, Lines& lines);

/// Appends the mesh, and the materials in a scope. @param root path of the prim around them
void add_mesh(const Asset& asset, const std::string& root, const std::string& folder, const std::string& file,
              Lines& lines, std::vector<PackageFile>& textures);

// Names of prims below the root.
inline constexpr const char *kSkeletonPrim = "Skeleton", *kMeshPrim = "Mesh", *kMaterialsPrim = "Materials";

}  // namespace anigen::io::usd_export
