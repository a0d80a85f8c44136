#include <new>
#include <stdexcept>

#include "anigen/asset/validate.h"
#include "anigen/core/error.h"
#include "anigen/io/gltf.h"
#include "anigen/io/gltf/import_animations.h"
#include "anigen/io/gltf/import_bind.h"
#include "anigen/io/gltf/import_container.h"
#include "anigen/io/gltf/import_images.h"
#include "anigen/io/gltf/import_mesh.h"
#include "anigen/io/gltf/import_parse.h"
#include "anigen/io/gltf/import_rig.h"
#include "anigen/io/gltf/import_tracks.h"

namespace anigen::io {
namespace {

ImportedAsset import_file(const std::filesystem::path& path, const ImportOptions& options) {
  namespace stage = gltf_import;
  stage::Notes notes;
  stage::Container container;
  stage::read_container(path, options, container);
  const stage::Document document = stage::parse_document(container, options, notes);
  const std::vector<stage::TrackSet> tracks = stage::read_tracks(document, notes);
  stage::Rig rig = stage::build_rig(document, stage::moving_nodes(document, tracks), options.max_joints, notes);
  const std::vector<stage::SkinBinding> bindings = stage::bind_skins(document, rig, notes);

  ImportedAsset result;
  Asset& asset = result.asset;
  asset.name = path.stem().string();
  stage::MergedMesh merged = stage::merge_meshes(document, rig, bindings, options, notes);
  asset.mesh = std::move(merged.mesh);
  asset.skin = std::move(merged.skin);
  stage::MaterialSet materials = stage::read_materials(document, container.folder, options, notes);
  asset.materials = std::move(materials.materials);
  asset.images = std::move(materials.images);
  asset.animations = stage::convert_animations(tracks, rig, notes);
  asset.skeleton = std::move(rig.skeleton);
  const std::vector<std::string> findings = validate(asset, 1);
  if (!findings.empty()) throw InputError(path.string(), "", "cannot be made a sound asset: " + findings.front());
  result.notes = notes.take();
  return result;
}

}  // namespace

ImportedAsset read_gltf(const std::filesystem::path& path, const ImportOptions& options) {
  try {
    return import_file(path, options);
  } catch (const std::bad_alloc&) {
    throw InputError(path.string(), "", "reading it needs more memory than there is");
  } catch (const std::length_error&) {
    throw InputError(path.string(), "", "reading it needs more memory than there is");
  }
}

}  // namespace anigen::io
