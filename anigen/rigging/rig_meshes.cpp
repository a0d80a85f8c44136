#include "anigen/rigging/rig_meshes.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <limits>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/parallel.h"
#include "anigen/core/process.h"
#include "anigen/core/text.h"
#include "anigen/core/version.h"
#include "anigen/geometry/primitives.h"
#include "anigen/io/gltf/export.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/gltf/graft.h"
#include "anigen/io/gltf/rig.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/io/write_rigged.h"
#include "anigen/rigging/bodies.h"
#include "anigen/rigging/write_rig.h"

namespace anigen::rigging {

namespace {

namespace fs = std::filesystem;
using Points = std::vector<Eigen::Vector3d>;

double mean_nearest_distance(const Points& from, const Points& to) {
  double sum = 0.0;
  for (const Eigen::Vector3d& point : from) {
    double nearest = std::numeric_limits<double>::infinity();
    for (const Eigen::Vector3d& other : to) nearest = std::min(nearest, (point - other).squaredNorm());
    sum += std::sqrt(nearest);
  }
  return sum / static_cast<double>(from.size());
}

double joint_distance(const Points& a, const Points& b) {
  return 0.5 * (mean_nearest_distance(a, b) + mean_nearest_distance(b, a));
}

const std::vector<std::pair<std::string, RiggingMethod>> kMethods{
    {"nearest", {JointSource::kGiven, SkinBinding::kNearest}},
    {"geovoxel", {JointSource::kGiven, SkinBinding::kGeodesicVoxels}},
    {"heat", {JointSource::kGiven, SkinBinding::kHeat}},
    {"template", {JointSource::kTemplate, SkinBinding::kNearest}},
    {"curve", {JointSource::kCurve, SkinBinding::kGeodesicVoxels}},
    {"pinocchio", {JointSource::kPinocchio, SkinBinding::kHeat}},
    {"auto", {JointSource::kAuto, SkinBinding::kHeat}},
};

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
    templates.push_back(template_from_skeleton(skeleton_in(shape), bounding_box(shape.mesh.vertices)));
    templates.back().name = options.skeleton.stem().string();
    return templates;
  }
  for (const std::string& word : options.templates.empty() ? usual_template_words() : options.templates)
    templates.push_back(species_template(word));
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

/// Learned joints, else a template where one fits, else the mesh's curve, which follows any shape; the first two
/// exchanged by JointOptions::templates_first. The note says which, and why.
ProposedJoints chosen_joints(const io::RiggedShape& shape, const std::vector<TemplateSkeleton>& templates,
                             const JointOptions& options) {
  const Mesh& mesh = shape.mesh;
  const bool named = !options.templates.empty();
  std::string why_not, refused;
  std::optional<ProposedJoints> learned;
  if (options.learned && !named) learned = options.learned(shape, why_not);
  if (learned && !options.templates_first) return std::move(*learned);
  std::optional<TemplateChoice> choice;
  try {
    choice = choose_template(mesh, templates, options.embedding);
  } catch (const Interrupted&) {
    throw;
  } catch (const Error& error) {
    refused = error.what();
  }
  char reason[160];
  if (choice) {
    const char* name = templates[choice->index].name.c_str();
    const bool fits = choice->embedded.penalty <= kTrustedPenalty;
    std::snprintf(reason, sizeof reason, "template %.40s %s: penalty %.3f, trusted up to %.2f", name,
                  fits ? "fits" : "does not fit", choice->embedded.penalty, kTrustedPenalty);
    if (named) std::snprintf(reason, sizeof reason, "template %.40s, penalty %.3f", name, choice->embedded.penalty);
    if (fits || named) return {std::move(choice->embedded.skeleton), reason};
  } else {
    std::snprintf(reason, sizeof reason, "no template: %.120s", refused.c_str());
  }
  std::string why = reason;
  if (options.learned && named) learned = options.learned(shape, why_not);
  if (learned) {
    learned->note += ", since " + why;
    return std::move(*learned);
  }
  if (options.learned) why += "; " + why_not;
  try {
    return {propose_curve_skeleton(mesh, options.curve), "curve, since " + why};
  } catch (const Interrupted&) {
    throw;
  } catch (const Error& error) {
    if (!choice) throw;
    return {std::move(choice->embedded.skeleton), why + ", but there is no curve: " + error.what()};
  }
}

/// Skeletons of a collection of rigs, each measured by its own mesh. Assets that a data set marks as unusable are left
/// out. @param collection whatever io::open_source reads @param splits files of ids; none: all
/// @throws InputError when nothing is left
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
      skeletons.push_back(
          boxed_skeleton(id, shape.joints.positions, shape.joints.parents, bounding_box(shape.mesh.vertices)));
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

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

/// Ids may hold folders, and come from files that somebody else wrote.
bool names_file_below(const std::string& id) {
  const fs::path below = id;
  bool leaves = below.empty() || below.is_absolute();
  for (const fs::path& part : below) leaves = leaves || part == ".." || part.empty();
  return !leaves;
}

/// @throws InputError for an id that leaves `out`
fs::path file_of(const RigRequest& request, const io::ShapeSource& source, const std::string& id) {
  if (source.is_single_file()) return request.out;
  if (!names_file_below(id))
    throw InputError(source.describe(), "", "the id \"" + id + "\" names no file below a folder");
  return request.out / (id + "." + request.format);
}

/// @throws InputError when the files to write have no format that rigs are written in
void refuse_formats(const RigRequest& request, const io::ShapeSource& source) {
  if (io::has_extension(request.out, {".vrm"})) return refuse_unfit_vrm(request, source);
  if (!source.is_single_file() && io::is_rigged_output(request.out) && !fs::is_directory(request.out))
    throw InputError(request.out.string(), "--output", "a file holds one mesh; several go to a folder");
  if (source.is_single_file() ? io::is_rigged_output(request.out) : io::is_rigged_output("rig." + request.format))
    return;
  throw InputError(
      source.is_single_file() ? request.out.string() : request.format, "--output",
      "rigs are written as ." + joined(io::rigged_format_words(), ", .", [](const std::string& w) { return w; }));
}

/// Everything that is read for these meshes.
std::vector<fs::path> inputs_of(const RigRequest& request, const io::ShapeSource& source,
                                const std::vector<std::string>& ids) {
  std::vector<fs::path> inputs = request.also_read;
  const auto add = [&inputs](const std::vector<fs::path>& files) {
    inputs.insert(inputs.end(), files.begin(), files.end());
  };
  const auto add_shapes = [&](const io::ShapeSource& shapes, const std::vector<std::string>& read) {
    for (const std::string& id : read) add(shapes.files(id));
  };
  add(request.splits);
  add(request.joints.splits);
  add_shapes(source, ids);
  for (const fs::path& other : {request.joints.skeleton, request.joints.collection}) {
    if (other.empty()) continue;
    const auto shapes = io::open_source(other);
    add_shapes(*shapes, shapes->ids());
  }
  return inputs;
}

void refuse_lossy_outputs(const RigRequest& request, const io::ShapeSource& source,
                          const std::vector<std::string>& ids) {
  std::vector<fs::path> outputs;
  for (const std::string& id : ids) {
    if (!source.is_single_file() && !names_file_below(id)) continue;
    outputs.push_back(file_of(request, source, id));
    if (!request.also_writes.empty())
      outputs.push_back(fs::path(outputs.back()).replace_extension(request.also_writes));
  }
  refuse_to_overwrite(outputs, [&] { return inputs_of(request, source, ids); });
}

/// Weights by the method's binding. Without a choice of method, heat is fitted_heat(), and a mesh whose equation of
/// heat has no solution is bound by paths through its inside, and the note says so.
SkinWeights bound(const Asset& asset, const RigRequest& request, std::string& note) {
  const bool is_chosen = request.method.joints != JointSource::kAuto;
  BindingOptions options = request.binding;
  if (!is_chosen) options.heat = fitted_heat(options.heat.most_influences);
  try {
    return bind(*request.method.binding, asset.mesh, asset.skeleton, options);
  } catch (const InputError&) {
    throw;
  } catch (const Interrupted&) {
    throw;
  } catch (const Error& error) {
    if (is_chosen || request.method.binding != SkinBinding::kHeat) throw;
    note += std::string(note.empty() ? "" : ", ") + "bound by geovoxel: " + error.what();
    return bind(SkinBinding::kGeodesicVoxels, asset.mesh, asset.skeleton, request.binding);
  }
}

bool keeps_joints(const io::RiggedShape& shape, const RigRequest& request) {
  const JointSource source = request.method.joints;
  const bool has_given = !request.joints.skeleton.empty() || (request.joints.keep_skeleton && shape.has_joints());
  return source == JointSource::kGiven || (source == JointSource::kAuto && has_given);
}

/// Joints of one body, as the request wants them.
ProposedJoints joints_of(const io::RiggedShape& shape, const JointProposer& proposer, const RigRequest& request) {
  const LearnedSteps& learned = request.learned;
  ProposedJoints proposed = learned.propose ? learned.propose(shape, proposer) : proposer.propose(shape);
  Skeleton& skeleton = proposed.skeleton;
  const std::size_t before = skeleton.size();
  const auto add = [&](const std::string& text) { proposed.note += (proposed.note.empty() ? "" : ", ") + text; };
  if (request.edits.extend) {
    if (!keeps_joints(shape, request))
      throw InputError(shape.file, "--add-joints", "holds no skeleton that joints could be added to");
    skeleton = extended_skeleton(skeleton, propose_curve_skeleton(shape.mesh, request.joints.curve), shape.mesh);
    add(std::to_string(skeleton.size() - before) + " joints added");
  }
  if (request.edits.symmetric) {
    const Box box = bounding_box(shape.mesh.vertices);
    skeleton = mirrored_skeleton(skeleton, box.center().x(), box.diagonal());
    add("made symmetric");
  }
  if (request.edits.joints > 0 && request.edits.joints != skeleton.size()) {
    add(std::to_string(request.edits.joints) + " joints made of " + std::to_string(skeleton.size()));
    skeleton = with_joint_count(skeleton, request.edits.joints);
  }
  return proposed;
}

SkinWeights weights_of(const io::RiggedShape& shape, const Skeleton& skeleton, const RigRequest& request,
                       std::string& note) {
  if (request.learned.bind) return request.learned.bind(shape, skeleton);
  Asset asset;
  asset.mesh = shape.mesh;
  asset.skeleton = skeleton;
  return bound(asset, request, note);
}

// Shapes are read without the orientation of their joints. Those of a file's own joints stay with its nodes.
Skeleton unrotated(const Skeleton& skeleton) { return io::unrotated_in_file(skeleton, io::ExportAxes::kGltf); }

}  // namespace

BoxedSkeleton boxed_skeleton(const std::string& id, const Points& joints, const std::vector<int>& parents,
                             const Box& box) {
  if (box.empty() || !box.low.allFinite() || !box.high.allFinite())
    throw InputError(id, "", "a skeleton is measured by its mesh, and there is none");
  if (joints.empty()) throw InputError(id, "", "there is no joint");
  BoxedSkeleton boxed{id, {}, parents};
  const Eigen::Vector3d extent = box.high - box.low;
  for (std::size_t j = 0; j < joints.size(); ++j) {
    if (!joints[j].allFinite()) throw InputError(id, "joint " + std::to_string(j), "is not finite");
    Eigen::Vector3d place = Eigen::Vector3d::Constant(0.5);
    for (int axis = 0; axis < 3; ++axis) {
      if (extent[axis] > 0.0) place[axis] = (joints[j][axis] - box.low[axis]) / extent[axis];
    }
    boxed.joints.push_back(place);
  }
  return boxed;
}

Points placed_joints(const BoxedSkeleton& skeleton, const Box& box) {
  Points joints;
  for (const Eigen::Vector3d& place : skeleton.joints)
    joints.push_back(box.low + place.cwiseProduct(box.high - box.low));
  return joints;
}

std::size_t medoid(const std::vector<BoxedSkeleton>& skeletons) {
  if (skeletons.empty()) throw InputError("", "", "the middle of no skeletons");
  // Every distance twice: N² of them would not fit for the data sets that people have.
  std::vector<double> sums(skeletons.size(), 0.0);
  Progress progress("comparing skeletons", skeletons.size(), "skeletons");
  parallel_for(skeletons.size(), [&](std::size_t i) {
    for (const BoxedSkeleton& other : skeletons) sums[i] += joint_distance(skeletons[i].joints, other.joints);
    progress.advance();
  });
  progress.finish();
  return static_cast<std::size_t>(std::min_element(sums.begin(), sums.end()) - sums.begin());
}

RiggingMethod parse_rigging_method(const std::string& method, const std::string& skin) {
  for (const auto& [word, known] : kMethods) {
    if (word != method) continue;
    RiggingMethod result = known;
    if (skin == "none") {
      result.binding.reset();
    } else if (!skin.empty()) {
      result.binding = parse_skin_binding(skin);
    }
    return result;
  }
  throw InputError("", "--method", "\"" + method + "\" is none of " + joined(rigging_method_words()));
}

std::vector<std::string> rigging_method_words() {
  std::vector<std::string> words;
  for (const auto& [word, unused] : kMethods) words.push_back(word);
  return words;
}

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
    case JointSource::kAuto:
      if (options_.skeleton.empty()) {
        templates_ = templates_of(options_);
      } else {
        given_ = skeleton_in(only_shape_of(options_.skeleton));
      }
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
      placed.joints.positions = placed_joints(boxed_, bounding_box(shape.mesh.vertices));
      placed.joints.parents = boxed_.parents;
      Skeleton skeleton = skeleton_in(placed);
      skeleton.names = joint_names(skeleton.positions(), skeleton.parents);
      return {std::move(skeleton), ""};
    }
    case JointSource::kCurve:
      return {propose_curve_skeleton(shape.mesh, options_.curve), ""};
    case JointSource::kAuto:
      if (!options_.skeleton.empty()) return {given_, "joints of " + options_.skeleton.filename().string()};
      if (shape.has_joints() && options_.keep_skeleton) return {skeleton_in(shape), kKeepsJoints};
      return chosen_joints(shape, templates_, options_);
    case JointSource::kPinocchio:
      break;
  }
  return embedded(shape.mesh, templates_, options_.embedding);
}

Asset rig_shape(const io::RiggedShape& shape, const JointProposer& proposer, const RigRequest& request,
                RigReport& report) {
  const auto started = std::chrono::steady_clock::now();
  const bool may_be_several = request.separate_bodies && request.method.joints == JointSource::kAuto &&
                              !keeps_joints(shape, request) && shape.has_surface() &&
                              !io::has_extension(request.out, {".vrm"});
  const std::vector<SeparateBody> bodies = may_be_several ? separate_bodies(shape.mesh) : std::vector<SeparateBody>();
  std::vector<io::RiggedShape> parts;
  std::vector<Skeleton> skeletons;
  for (const SeparateBody& body : bodies) {
    parts.emplace_back(shape.id, shape.file);
    parts.back().mesh = body.mesh;
    ProposedJoints proposed = joints_of(parts.back(), proposer, request);
    add_note("body " + std::to_string(parts.size()) + ": " + proposed.note, report);
    skeletons.push_back(std::move(proposed.skeleton));
  }
  if (bodies.empty()) {
    ProposedJoints proposed = joints_of(shape, proposer, request);
    report.note = std::move(proposed.note);
    skeletons.push_back(std::move(proposed.skeleton));
  }
  Skeleton skeleton = unrotated(bodies.empty() ? skeletons.front() : joined_skeleton(skeletons));
  report.joint_seconds = seconds_since(started);
  if (!request.method.binding) {
    if (request.engine.any()) {
      const EngineRig rig = engine_rig(skeleton, bounding_box(shape.mesh.vertices), {}, request.engine, shape.file);
      add_note(rig.note, report);
      skeleton = oriented(rig, request.engine);
    }
    Asset solid = geometry::skeleton_asset(skeleton);
    solid.name = shape.id;
    return solid;
  }
  const auto found = std::chrono::steady_clock::now();
  if (!shape.has_surface()) throw InputError(shape.file, "", "holds no surface to rig");
  Asset asset;
  asset.name = shape.id;
  asset.mesh = shape.mesh;
  asset.materials = shape.materials;
  asset.images = shape.images;
  asset.skeleton = std::move(skeleton);
  if (bodies.empty()) {
    asset.skin = weights_of(shape, asset.skeleton, request, report.note);
  } else {
    std::vector<SkinWeights> skins;
    for (std::size_t b = 0; b < bodies.size(); ++b)
      skins.push_back(weights_of(parts[b], unrotated(skeletons[b]), request, report.note));
    asset.skin = joined_skin(bodies, skins, skeletons, shape.mesh.vertices.size());
  }
  if (request.rigid_share) {
    RigidSkin rigid = rigid_parts(asset.mesh, asset.skin, *request.rigid_share);
    add_note(rigid.note(), report);
    report.rigid_parts = rigid.to_json(asset.skeleton);
    asset.skin = std::move(rigid.skin);
  }
  report.binding_seconds = seconds_since(found);
  return asset;
}

RigReports rig_meshes(const RigRequest& request) {
  const auto source = io::open_meshes(request.meshes, {request.axes, false});
  const std::vector<std::string> ids = io::select_ids(*source, request.splits);
  refuse_lossy_outputs(request, *source, ids);
  refuse_formats(request, *source);
  const JointProposer proposer(request.method.joints, request.joints);
  RigReports reports;
  reports.skeleton = proposer.template_id();
  Progress progress("rigging", ids.size(), "meshes");
  for (const std::string& id : ids) {
    throw_if_interrupted();
    const auto started = std::chrono::steady_clock::now();
    RigReport report;
    report.id = id;
    try {
      report.file = file_of(request, *source, id);
      const io::RiggedShape shape = source->read(id);
      Asset asset = rig_shape(shape, proposer, request, report);
      write_rig(request, shape, asset, report);
      report.joints = asset.skeleton.size();
      report.vertices = asset.mesh.vertices.size();
      if (request.also) request.also(asset, report.file);
    } catch (...) {
      report.failure = failure_of_item();
      log::warn("{}: {}", id, report.failure);
    }
    report.seconds = seconds_since(started);
    reports.meshes.push_back(std::move(report));
    progress.advance();
  }
  progress.finish();
  return reports;
}

Json to_json(const RigReports& reports) {
  Json list = Json::array();
  for (const RigReport& report : reports.meshes) {
    Json one = {{"id", report.id}, {"file", report.file.string()}, {"seconds", report.seconds}};
    if (report.failure.empty()) {
      one["joints"] = report.joints;
      one["vertices"] = report.vertices;
      one["joint_seconds"] = report.joint_seconds;
      one["binding_seconds"] = report.binding_seconds;
      if (!report.note.empty()) one["note"] = report.note;
      if (!report.rigid_parts.is_null()) one["rigid_parts"] = report.rigid_parts;
    } else {
      one["failure"] = report.failure;
    }
    list.push_back(std::move(one));
  }
  Json json = {{"made_by", made_by()}, {"meshes", std::move(list)}};
  if (!reports.skeleton.empty()) json["template"] = reports.skeleton;
  return json;
}

std::string to_text(const RigReports& reports) {
  std::string text;
  if (!reports.skeleton.empty()) text = "template: the skeleton of " + reports.skeleton + "\n";
  for (const RigReport& report : reports.meshes) {
    text += report.id + ": ";
    if (!report.failure.empty()) {
      text += report.failure + "\n";
      continue;
    }
    char line[96];
    std::snprintf(line, sizeof line, ", %zu joints, %zu vertices, %.2f s", report.joints, report.vertices,
                  report.seconds);
    text += report.file.string() + line + (report.note.empty() ? "" : ", " + report.note) + "\n";
  }
  return text;
}

}  // namespace anigen::rigging
