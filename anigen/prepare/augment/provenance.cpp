#include "anigen/prepare/augment/provenance.h"

namespace anigen::prepare {

std::string to_string(PoseKind kind) { return kind == PoseKind::kAnimation ? "animation" : "random"; }

Json to_json(const Provenance& provenance) {
  Json json;
  json["source"] = provenance.source_id;
  json["seed"] = provenance.seed;
  json["k"] = provenance.k;
  json["kind"] = to_string(provenance.kind);
  if (provenance.kind == PoseKind::kAnimation) {
    json["clip"] = provenance.clip;
    json["time"] = provenance.time;
    json["second_time"] = provenance.second_time;
    json["blend"] = provenance.blend;
  }
  json["attempt"] = provenance.attempt;
  json["turned_joints"] = provenance.turned;
  json["largest_angle_degrees"] = provenance.largest_angle;
  json["scale"] = provenance.renormalization.scale;
  const Eigen::Vector3d& offset = provenance.renormalization.offset;
  json["offset"] = {offset.x(), offset.y(), offset.z()};
  json["measures"] = to_json(provenance.measures);
  json["rejections"] = provenance.rejections;
  json["unused_clips"] = provenance.unused_clips;
  return json;
}

}  // namespace anigen::prepare
