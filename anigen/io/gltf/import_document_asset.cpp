#include "anigen/io/gltf/import_document_asset.h"

#include <utility>
#include <vector>

#include "anigen/asset/validate.h"
#include "anigen/core/error.h"
#include "anigen/io/gltf/import_animations.h"
#include "anigen/io/gltf/import_bind.h"
#include "anigen/io/gltf/import_images.h"
#include "anigen/io/gltf/import_mesh.h"
#include "anigen/io/gltf/import_rig.h"
#include "anigen/io/gltf/import_tracks.h"

namespace anigen::io::gltf_import {

ImportedAsset document_asset(const Document& document, const std::filesystem::path& path, const ImportOptions& options,
                             Notes& notes) {
  const std::vector<TrackSet> tracks = read_tracks(document, notes);
  Rig rig = build_rig(document, moving_nodes(document, tracks), options, notes);
  const std::vector<SkinBinding> bindings = bind_skins(document, rig, notes);

  ImportedAsset result;
  Asset& asset = result.asset;
  asset.name = path.stem().string();
  MergedMesh merged = merge_meshes(document, rig, bindings, options, notes);
  asset.mesh = std::move(merged.mesh);
  asset.skin = std::move(merged.skin);
  MaterialSet materials = read_materials(document, path.parent_path(), options, notes);
  asset.materials = std::move(materials.materials);
  asset.images = std::move(materials.images);
  if (rig.skeleton.size() > 0)
    asset.animations = convert_animations(tracks, rig, notes);
  else
    result.node_clips = clips_of_nodes(tracks);
  asset.skeleton = std::move(rig.skeleton);
  result.frame = document.frame;
  const std::vector<std::string> findings = validate(asset, 1, options.require_rig);
  if (!findings.empty()) throw InputError(path.string(), "", "cannot be made a sound asset: " + findings.front());
  result.notes = notes.take();
  result.lowest_weight_sum = notes.lowest_weight_sum();
  return result;
}

}  // namespace anigen::io::gltf_import
