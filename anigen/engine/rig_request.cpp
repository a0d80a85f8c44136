#include "anigen/engine/rig_request.h"

#include <utility>

#include "anigen/engine/module.h"

namespace anigen::engine {

rigging::RigRequest rig_request(const RigOptions& options, rigging::RigRequest further) {
  rigging::RigRequest request = std::move(further);
  request.method = rigging::parse_rigging_method(options.method, options.skin);
  request.joints.templates = options.templates;
  request.joints.keep_skeleton = options.keep_skeleton;
  if (request.method.joints == rigging::JointSource::kAuto && options.learned_joints)
    request.joints.learned = sure_joints();
  request.edits = {options.joints, options.symmetric, options.add_joints};
  request.separate_bodies = options.separate_bodies;
  request.influences = request.binding.geodesic.most_influences = request.binding.heat.most_influences =
      options.influences;
  if (options.rigid_share != 0.0) request.rigid_share = options.rigid_share;
  if (!options.bone_axes.empty()) request.engine.axes = rigging::parse_bone_axes(options.bone_axes);
  if (!options.names.empty()) request.engine.names = rigging::parse_name_style(options.names);
  // Names of humans need all of their bones, which templates have.
  request.joints.templates_first =
      request.engine.humanoid || (request.engine.names && *request.engine.names != rigging::NameStyle::kChain);
  request.engine.height = options.height;
  request.engine.ground = options.ground;
  request.engine.root_bone = options.root_bone;
  return request;
}

}  // namespace anigen::engine
