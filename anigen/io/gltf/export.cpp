#include <string>
#include <vector>

#include "anigen/asset/validate.h"
#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/io/gltf.h"
#include "anigen/io/gltf/export_animations.h"
#include "anigen/io/gltf/export_axes.h"
#include "anigen/io/gltf/export_container.h"
#include "anigen/io/gltf/export_document.h"
#include "anigen/io/gltf/export_materials.h"
#include "anigen/io/gltf/export_mesh.h"
#include "anigen/io/gltf/export_nodes.h"
#include "anigen/io/gltf/export_skin.h"

namespace anigen::io {
namespace {

void refuse_unsound(const std::string& file, const Asset& asset, const ExportOptions& options) {
  const std::vector<std::string> findings = validate(asset, 3, options.require_rig);
  if (!findings.empty()) {
    std::string problem = "asset is not sound: " + findings.front();
    if (findings.size() > 1) problem += " (and " + std::to_string(findings.size() - 1) + " more)";
    throw InputError(file, "", problem);
  }
  const bool has_mesh = !asset.mesh.vertices.empty(), has_skeleton = asset.skeleton.size() > 0;
  if (asset.mesh.faces.empty() && (has_mesh || options.require_rig))
    throw InputError(file, "", "asset has no faces to write");
  if (!has_skeleton && options.require_rig) throw InputError(file, "", "asset has no skeleton to write");
  if (has_mesh && has_skeleton && asset.skin.rows() == 0)
    throw InputError(file, "",
                     "asset has a mesh and a skeleton but no skin weights; anigen-rig --method heat makes some");
  if (options.influences == 0) throw InputError(file, "", "influences per vertex must be at least 1");
  constexpr std::size_t kMostJoints = 65536;
  if (asset.skeleton.size() > kMostJoints) throw NotSupportedError(file, "", "more than 65536 joints in glTF");
}

}  // namespace

void write_gltf(const std::filesystem::path& path, const Asset& asset, const ExportOptions& options) {
  const std::string file = path.string();
  const bool binary = is_binary_extension(path);
  refuse_unsound(file, asset, options);
  const Eigen::Matrix3d rotation = axis_rotation(options.axes);
  GltfDocument document;
  write_nodes(document, asset, options.axes);
  if (!asset.mesh.vertices.empty()) {
    const std::map<int, int> materials = write_materials(document, asset, file);
    write_mesh(document, asset, rotation, materials, options.influences);
  }
  if (asset.skeleton.size() > 0) write_skin(document, asset.skeleton, rotation, file);
  if (options.animations) write_animations(document, asset, options.axes, file);
  write_file_atomically(path, binary ? glb_bytes(document, file) : embedded_gltf_bytes(document));
}

}  // namespace anigen::io
