#include "anigen/io/rigs/assimp_scene.h"

#include <new>
#include <stdexcept>

#include "anigen/core/error.h"
#include "anigen/io/gltf/import_document_asset.h"
#include "anigen/io/rigs/assimp_animations.h"
#include "anigen/io/rigs/assimp_load.h"
#include "anigen/io/rigs/assimp_materials.h"
#include "anigen/io/rigs/assimp_meshes.h"
#include "anigen/io/rigs/assimp_nodes.h"
#include "anigen/io/rigs/file_list.h"

namespace anigen::io {

ImportedAsset read_assimp(const std::filesystem::path& path, const ImportOptions& options) {
  try {
    Assimp::Importer importer;
    const aiScene& scene = assimp_import::load(importer, path, options);
    gltf_import::Notes notes;
    gltf_import::Document document;
    document.file = path.string();
    const assimp_import::NodeTable nodes = assimp_import::add_nodes(scene, lower_extension(path) == ".fbx", document);
    assimp_import::add_animations(scene, nodes, document);
    assimp_import::add_meshes(scene, nodes, document, notes);
    assimp_import::add_materials(scene, path.parent_path(), document);
    importer.FreeScene();
    return gltf_import::document_asset(document, path, options, notes);
  } catch (const std::bad_alloc&) {
    throw InputError(path.string(), "", "reading it needs more memory than there is");
  } catch (const std::length_error&) {
    throw InputError(path.string(), "", "reading it needs more memory than there is");
  }
}

}  // namespace anigen::io
