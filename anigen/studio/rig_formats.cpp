#include "anigen/studio/rig_formats.h"

#include "anigen/core/numeric.h"
#include "anigen/engine/files.h"
#include "anigen/rigging/write_rig.h"
#include "anigen/studio/obj_archive.h"

namespace anigen::studio {

namespace {

void write_vrm(Asset asset, const std::filesystem::path& file) {
  rigging::RigRequest request;
  request.graft = false;
  request.influences = 0;
  request.out = file;
  request.engine.humanoid = true;
  request.method = rigging::parse_rigging_method("heat");  // the file has weights; nothing is bound here
  rigging::RigReport report;
  report.id = asset.name;
  report.file = file;
  io::RiggedShape shape;
  shape.file = asset.name;
  rigging::write_rig(request, shape, asset, report);
}

}  // namespace

void write_rig_file(const Asset& asset, const std::filesystem::path& file) {
  if (file.extension() == ".vrm") return write_vrm(asset, file);
  if (file.extension() == ".zip") return write_obj_archive(asset, file);
  engine::save(asset, file);
}

Asset renamed(const Asset& asset, const std::string& preset) {
  rigging::EngineOptions options;
  options.names = rigging::parse_name_style(preset);
  const rigging::EngineRig rig =
      rigging::engine_rig(asset.skeleton, bounding_box(asset.mesh.vertices),
                          rigging::weight_of_joints(asset.skin, asset.skeleton.size()), options, asset.name);
  Asset named = asset;
  if (rig.has_given_joints) {
    for (std::size_t j = 0; j < named.skeleton.size(); ++j)
      named.skeleton.names[j] = rig.skeleton.names[at(rig.new_joint[j])];
    return named;
  }
  rigging::apply(rig, named);
  named.skeleton = rigging::oriented(rig, options);
  return named;
}

}  // namespace anigen::studio
