#include "anigen/rig/joint_proposer.h"

#include <cstdio>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/interrupt.h"
#include "anigen/core/log.h"
#include "anigen/core/progress.h"
#include "anigen/geometry/joint_names.h"
#include "anigen/io/rigs/shape_source.h"
#include "anigen/io/rigs/split.h"

namespace anigen::rig {
namespace {

namespace fs = std::filesystem;

Box box_around(const io::RiggedShape& shape) { return bounding_box(shape.mesh.vertices); }

/// @return one that belongs to an asset: parents first, one root
Skeleton skeleton_in(const io::RiggedShape& shape) {
  if (!shape.has_joints()) throw InputError(shape.file, "", "holds no skeleton");
  return io::to_asset(shape).skeleton;
}

io::RiggedShape only_shape_of(const fs::path& file) {
  const auto source = io::open_source(file);
  const std::vector<std::string> ids = source->ids();
  if (ids.size() != 1) throw InputError(file.string(), "", "holds " + std::to_string(ids.size()) + " rigs, not one");
  return source->read(ids.front());
}

std::vector<TemplateSkeleton> templates_of(const JointOptions& options) {
  std::vector<TemplateSkeleton> templates;
  if (!options.skeleton.empty()) {
    const io::RiggedShape shape = only_shape_of(options.skeleton);
    templates.push_back(template_from_skeleton(skeleton_in(shape), box_around(shape)));
    templates.back().name = options.skeleton.stem().string();
    return templates;
  }
  for (const std::string& word : options.templates.empty() ? template_words() : options.templates) {
    if (word == "biped") {
      templates.push_back(biped_template());
    } else if (word == "quadruped") {
      templates.push_back(quadruped_template());
    } else {
      throw InputError("", "--template", "\"" + word + "\" is neither biped nor quadruped");
    }
  }
  return templates;
}

ProposedJoints embedded(const Mesh& mesh, const std::vector<TemplateSkeleton>& templates,
                        const EmbeddingOptions& options) {
  TemplateChoice choice = choose_template(mesh, templates, options);
  char note[160];
  std::snprintf(note, sizeof note, "%.40s, penalty %.3f%s%s", templates[choice.index].name.c_str(),
                choice.embedded.penalty, choice.embedded.penalty >= 1.0 ? " (fits badly)" : "",
                choice.embedded.best ? "" : ", perhaps not the best embedding");
  return {std::move(choice.embedded.skeleton), note};
}

}  // namespace

std::vector<std::string> template_words() { return {"biped", "quadruped"}; }

JointProposer::JointProposer(JointSource source, JointOptions options) : source_(source), options_(std::move(options)) {
  switch (source_) {
    case JointSource::kGiven:
      if (!options_.skeleton.empty()) given_ = skeleton_in(only_shape_of(options_.skeleton));
      break;
    case JointSource::kTemplate: {
      const std::vector<BoxedSkeleton> skeletons = skeletons_of(options_.collection, options_.splits);
      boxed_ = skeletons[medoid(skeletons)];
      break;
    }
    case JointSource::kCurve:
      break;
    case JointSource::kPinocchio:
      templates_ = templates_of(options_);
      break;
  }
}

ProposedJoints JointProposer::propose(const io::RiggedShape& shape) const {
  if (!shape.has_surface()) throw InputError(shape.file, "", "holds no surface to rig");
  switch (source_) {
    case JointSource::kGiven:
      if (!options_.skeleton.empty()) return {given_, ""};
      if (!shape.has_joints())
        throw InputError(shape.file, "", "holds no skeleton to bind to; name one, or a method that finds joints");
      return {skeleton_in(shape), ""};
    case JointSource::kTemplate: {
      io::RiggedShape placed;
      placed.joints.positions = placed_joints(boxed_, box_around(shape));
      placed.joints.parents = boxed_.parents;
      Skeleton skeleton = skeleton_in(placed);
      skeleton.names = geometry::joint_names(skeleton.positions(), skeleton.parents);
      return {std::move(skeleton), ""};
    }
    case JointSource::kCurve:
      return {propose_curve_skeleton(shape.mesh, options_.curve), ""};
    case JointSource::kPinocchio:
      break;
  }
  return embedded(shape.mesh, templates_, options_.embedding);
}

std::vector<BoxedSkeleton> skeletons_of(const fs::path& collection, const std::vector<fs::path>& splits) {
  const auto source = io::open_source(collection);
  std::vector<BoxedSkeleton> skeletons;
  std::size_t left_out = 0;
  const std::vector<std::string> ids = io::select_ids(*source, splits);
  Progress progress("reading skeletons", ids.size(), "assets");
  for (const std::string& id : ids) {
    throw_if_interrupted();
    progress.advance();
    if (!source->is_usable(id)) continue;
    try {
      const io::RiggedShape shape = source->read(id);
      skeletons.push_back(boxed_skeleton(id, shape.joints.positions, shape.joints.parents, box_around(shape)));
    } catch (...) {
      ++left_out;
      log::debug("{}: {}", id, failure_of_item());
    }
  }
  progress.finish();
  if (skeletons.empty()) throw InputError(collection.string(), "", "holds no skeleton with a mesh that could be used");
  if (left_out > 0) log::info("{} assets of {} have no usable skeleton", left_out, collection.string());
  return skeletons;
}

}  // namespace anigen::rig
