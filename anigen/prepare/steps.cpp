#include "anigen/prepare/steps.h"

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <string>
#include <system_error>
#include <utility>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/random.h"
#include "anigen/geometry/voxelize.h"
#include "anigen/io/arrays/npz.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/image.h"
#include "anigen/io/ply.h"
#include "anigen/prepare/sources.h"
#include "anigen/render/cameras_json.h"
#include "anigen/render/dataset_views.h"
#include "anigen/render/scene.h"

namespace anigen::prepare {

void write_voxel_ply(const std::filesystem::path& path, std::vector<geometry::Voxel> voxels, int resolution) {
  if (voxels.empty()) throw InputError(path.string(), "", "there are no voxels to write");
  geometry::require_inside(voxels, resolution);
  geometry::sort_unique(voxels);
  Mesh centers;
  centers.vertices.reserve(voxels.size());
  for (const geometry::Voxel& voxel : voxels) {
    centers.vertices.push_back(geometry::voxel_center(voxel, resolution).cast<float>());
  }
  io::write_ply(path, centers);
}

std::vector<geometry::Voxel> read_voxel_rows(const std::filesystem::path& path, int resolution) {
  geometry::require_resolution(resolution);
  const Mesh centers = io::read_ply(path);
  std::vector<geometry::Voxel> voxels;
  voxels.reserve(centers.vertices.size());
  for (std::size_t row = 0; row < centers.vertices.size(); ++row) {
    try {
      voxels.push_back(geometry::voxel_at(centers.vertices[row].cast<double>(), resolution));
    } catch (const InputError& error) {
      throw InputError(path.string(), "vertex " + std::to_string(row), error.problem());
    }
  }
  return voxels;
}

std::vector<geometry::Voxel> read_voxel_ply(const std::filesystem::path& path, int resolution) {
  std::vector<geometry::Voxel> voxels = read_voxel_rows(path, resolution);
  geometry::sort_unique(voxels);
  return voxels;
}

std::vector<std::filesystem::path> VoxelStep::outputs(const AssetPlaces& places, const Json&) const {
  return {places.surface_voxels(), places.skeleton_voxels()};
}

Json VoxelStep::run(AssetJob& job) const {
  const Asset& asset = job.asset();
  const auto surface = geometry::voxelize_surface(asset.mesh.vertices, asset.mesh.faces, resolution_);
  const auto skeleton = geometry::voxelize_bones(asset.skeleton.positions(), asset.skeleton.parents, resolution_);
  write_voxel_ply(job.places().surface_voxels(), surface, resolution_);
  write_voxel_ply(job.places().skeleton_voxels(), skeleton, resolution_);
  job.forget_voxels();
  return {{"num_voxels", surface.size()}, {"num_skeleton_voxels", skeleton.size()}};
}

std::vector<std::filesystem::path> SkeletonStep::outputs(const AssetPlaces& places, const Json&) const {
  return {places.skeleton()};
}

Json SkeletonStep::run(AssetJob& job) const {
  write_skeleton_archive(job.places().skeleton(), job.asset());
  return Json::object();
}

std::vector<std::filesystem::path> KeepAssetStep::outputs(const AssetPlaces& places, const Json&) const {
  return {places.asset()};
}

Json KeepAssetStep::run(AssetJob& job) const {
  io::ExportOptions exported;
  exported.influences = std::max<std::size_t>(1, job.asset().skin.largest_row());
  io::write_gltf(job.places().asset(), job.asset(), exported);
  return Json::object();
}

FeatureStep::FeatureStep(std::shared_ptr<const FeatureExtractor> extractor, int resolution)
    : extractor_(std::move(extractor)), resolution_(resolution) {
  if (resolution_ > 256) {
    throw InputError("", "--resolution", "features index voxels by bytes: at most 256 with --features");
  }
}

std::vector<std::string> FeatureStep::inputs() const {
  if (extractor_->needs_views()) return {kImport, "voxels", "views"};
  return {kImport, "voxels"};
}

Json FeatureStep::options() const { return {{"model", extractor_->fingerprint()}}; }

std::vector<std::filesystem::path> FeatureStep::outputs(const AssetPlaces& places, const Json&) const {
  return {places.features(extractor_->name())};
}

Json FeatureStep::run(AssetJob& job) const {
  const std::vector<geometry::Voxel>& voxels = job.surface_voxels(resolution_);
  const FeatureRequest request{job.asset(), voxels, resolution_,
                               extractor_->needs_views() ? job.places().views() : std::filesystem::path()};
  io::NdArray features = extractor_->extract(request);
  const auto rows = static_cast<std::int64_t>(voxels.size());
  if (features.dtype != io::Dtype::kF16 || features.shape != std::vector<std::int64_t>{rows, extractor_->channels()}) {
    throw Error("feature extractor " + extractor_->name() + " gave another shape or type than it announces");
  }
  std::vector<std::uint8_t> indices;
  indices.reserve(3 * voxels.size());
  for (const geometry::Voxel& voxel : voxels) {
    for (const std::int32_t coordinate : voxel) indices.push_back(static_cast<std::uint8_t>(coordinate));
  }
  io::write_npz(job.places().features(extractor_->name()),
                {{"indices", io::NdArray::from(indices, {rows, 3})}, {"patchtokens", std::move(features)}});
  return {{"channels", extractor_->channels()}};
}

namespace {

namespace fs = std::filesystem;

Json step_options(const ViewSettings& settings) {
  Json json{{"count", settings.count},
            {"size", settings.size},
            {"samples", settings.samples_per_axis},
            {"geometry", settings.geometry},
            {"seed", settings.seed}};
  // Said only where it holds, so that the records of data sets made before there was a choice still fit.
  if (settings.front) json["front"] = true;
  return json;
}

/// "007.png" and, for an aspect, "007_normal.png".
std::string picture_name(std::size_t index, const std::string& aspect = "") {
  char number[24];
  std::snprintf(number, sizeof number, "%03zu", index);
  return number + (aspect.empty() ? "" : "_" + aspect) + ".png";
}

/// @param aspects further pictures of each view, where the options ask for geometry
std::vector<fs::path> view_files(const fs::path& folder, const Json& options, const std::vector<std::string>& aspects) {
  std::vector<fs::path> files{folder / "transforms.json"};
  const bool geometry = options.value("geometry", false);
  for (std::size_t i = 0; i < options.value("count", std::size_t{0}); ++i) {
    files.push_back(folder / picture_name(i));
    if (!geometry) continue;
    for (const std::string& aspect : aspects) files.push_back(folder / picture_name(i, aspect));
  }
  return files;
}

void clear_folder(const fs::path& folder) {
  std::error_code ignored;
  fs::remove_all(folder, ignored);
}

render::ViewOptions view_options(const ViewSettings& settings) {
  render::ViewOptions options;
  options.size = settings.size;
  options.samples_per_axis = settings.samples_per_axis;
  return options;
}

/// Cameras are drawn from a stream of the asset's own, so that they do not depend on what else is prepared.
Rng camera_rng(const ViewSettings& settings, const std::string& purpose, const std::string& id) {
  return Rng(settings.seed, purpose + "/" + id);
}

void write_bytes(const fs::path& file, const std::vector<std::uint8_t>& bytes) {
  write_file_atomically(file, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
}

/// Called for every view with its number, to write what else is wanted of it.
using OtherPictures = std::function<void(const render::ViewImages&, const render::Frame&, std::size_t)>;

void render_views(AssetJob& job, render::ViewOptions options, const std::vector<render::ViewCamera>& cameras,
                  const fs::path& folder, const OtherPictures& others) {
  const render::Scene scene(job.asset());
  const render::ViewRenderer renderer(scene);
  render::Transforms transforms = render::make_transforms(cameras, job.normalisation());
  for (std::size_t i = 0; i < transforms.frames.size(); ++i) {
    render::Frame& frame = transforms.frames[i];
    frame.file_path = picture_name(i);
    const render::ViewImages images = renderer.render(frame, options);
    io::write_png(folder / frame.file_path, images.color);
    others(images, frame, i);
  }
  // Last: whoever finds it finds all pictures it names.
  render::write_transforms(folder / "transforms.json", transforms);
}

}  // namespace

Json ViewStep::options() const { return step_options(settings_); }

std::vector<fs::path> ViewStep::outputs(const AssetPlaces& places, const Json& options) const {
  std::vector<fs::path> files = view_files(places.views(), options, {"normal", "depth"});
  files.push_back(places.views() / "mesh.ply");
  return files;
}

void ViewStep::clear(const AssetPlaces& places) const { clear_folder(places.views()); }

Json ViewStep::run(AssetJob& job) const {
  const Asset& asset = job.asset();
  Rng rng = camera_rng(settings_, "feature views", job.id());
  const double offset0 = rng.uniform(), offset1 = rng.uniform();
  Mesh plain;
  plain.vertices = asset.mesh.vertices;
  plain.faces = asset.mesh.faces;
  io::write_ply(job.places().views() / "mesh.ply", plain);
  render::ViewOptions options = view_options(settings_);
  options.geometry = settings_.geometry;
  const fs::path folder = job.places().views();
  render_views(job, options, render::feature_views(settings_.count, offset0, offset1), folder,
               [&](const render::ViewImages& images, const render::Frame&, std::size_t i) {
                 if (!settings_.geometry) return;
                 io::write_png(folder / picture_name(i, "normal"), render::encode_world_normals(images));
                 write_bytes(folder / picture_name(i, "depth"), render::encode_depth_png(images));
               });
  return {{"views", settings_.count}};
}

Json ConditionViewStep::options() const { return step_options(settings_); }

std::vector<fs::path> ConditionViewStep::outputs(const AssetPlaces& places, const Json& options) const {
  return view_files(places.condition_views(), options, {"normal"});
}

void ConditionViewStep::clear(const AssetPlaces& places) const { clear_folder(places.condition_views()); }

Json ConditionViewStep::run(AssetJob& job) const {
  Rng rng = camera_rng(settings_, "condition views", job.id());
  render::ViewOptions options = view_options(settings_);
  options.mean_normal = settings_.geometry;
  const fs::path folder = job.places().condition_views();
  const auto cameras =
      settings_.front ? render::front_views(settings_.count, rng) : render::condition_views(settings_.count, rng);
  render_views(job, options, cameras, folder,
               [&](const render::ViewImages& images, const render::Frame& frame, std::size_t i) {
                 if (!settings_.geometry) return;
                 io::write_png(folder / picture_name(i, "normal"), render::encode_condition_normals(images, frame));
               });
  return {{"cond_views", settings_.count}};
}

namespace {

/// Views that the published system renders (reference training-and-data.md, 1.1), for `--steps views` without a number.
constexpr std::size_t kPublishedViews = 150, kPublishedConditionViews = 24;

ViewSettings with_count(ViewSettings settings, std::size_t published, std::uint64_t seed) {
  if (settings.count == 0) settings.count = published;
  settings.seed = seed;
  return settings;
}

void check_views(const ViewSettings& settings, const std::string& option) {
  // Three digits name the pictures of the published layout.
  if (settings.count > 1000) throw InputError("", option, "at most 1000 views");
  if (settings.size < 8 || settings.size > 4096) throw InputError("", option + "-size", "must lie in 8 … 4096 pixels");
  if (settings.samples_per_axis < 1 || settings.samples_per_axis > 16) {
    throw InputError("", "--view-samples", "must lie in 1 … 16");
  }
}

Json to_json(const ViewSettings& settings) {
  return {{"count", settings.count},
          {"size", settings.size},
          {"samples", settings.samples_per_axis},
          {"geometry", settings.geometry},
          {"front", settings.front}};
}

ViewSettings view_settings(const Json& json) {
  ViewSettings settings;
  json.at("count").get_to(settings.count);
  json.at("size").get_to(settings.size);
  json.at("samples").get_to(settings.samples_per_axis);
  json.at("geometry").get_to(settings.geometry);
  settings.front = json.value("front", false);
  return settings;
}

}  // namespace

const std::vector<std::string>& step_words() {
  static const std::vector<std::string> words{"import", "asset", "augment",    "skeleton",
                                              "voxels", "views", "cond_views", "features"};
  return words;
}

bool StepPlan::wants(const std::string& word) const {
  if (word == "augment" && variants > 0) return true;
  if (!steps.empty()) return std::find(steps.begin(), steps.end(), word) != steps.end();
  if (word == "asset") return keep_assets;
  if (word == "views") return views.count > 0;
  if (word == "cond_views") return condition_views.count > 0;
  if (word == "features") return !features.model.empty();
  return word != "augment";
}

void StepPlan::validate() const {
  for (const std::string& word : steps) {
    if (std::find(step_words().begin(), step_words().end(), word) != step_words().end()) continue;
    const std::string near = nearest_word(word, step_words());
    throw InputError("", "--steps",
                     "unknown step \"" + word + "\"" + (near.empty() ? "" : "; did you mean \"" + near + "\"?"));
  }
  if (wants("features") && features.model.empty()) throw InputError("", "--steps", "features need --features MODEL");
  if (wants("augment") && variants == 0) throw InputError("", "--steps", "augment needs --augment K");
  if (resolution < 2 || resolution > 1024) throw InputError("", "--resolution", "must lie in 2 … 1024");
  if (variants > 10000) throw InputError("", "--augment", "at most 10000 variants");
  check_views(views, "--views");
  check_views(condition_views, "--cond-views");
  poses.validate();
  cleaning.validate();
}

Json to_json(const StepPlan& plan) {
  return {
      {"steps", plan.steps},
      {"keep_assets", plan.keep_assets},
      {"resolution", plan.resolution},
      {"views", to_json(plan.views)},
      {"cond_views", to_json(plan.condition_views)},
      {"features",
       {{"model", plan.features.model}, {"weights", plan.features.weights.string()}, {"device", plan.features.device}}},
      {"variants", plan.variants},
      {"own_motion", plan.poses.own_motion},
      {"pose_probability", plan.poses.probability},
      {"pose_max_angle", plan.poses.max_angle},
      {"cleaning", to_json(plan.cleaning)},
      {"seed", plan.seed}};
}

StepPlan step_plan_from_json(const Json& json) {
  StepPlan plan;
  json.at("steps").get_to(plan.steps);
  json.at("keep_assets").get_to(plan.keep_assets);
  json.at("resolution").get_to(plan.resolution);
  plan.views = view_settings(json.at("views"));
  plan.condition_views = view_settings(json.at("cond_views"));
  const Json& features = json.at("features");
  features.at("model").get_to(plan.features.model);
  plan.features.weights = features.at("weights").get<std::string>();
  features.at("device").get_to(plan.features.device);
  json.at("variants").get_to(plan.variants);
  json.at("own_motion").get_to(plan.poses.own_motion);
  json.at("pose_probability").get_to(plan.poses.probability);
  json.at("pose_max_angle").get_to(plan.poses.max_angle);
  plan.cleaning = cleaning_options_from_json(json.at("cleaning"));
  json.at("seed").get_to(plan.seed);
  return plan;
}

std::shared_ptr<const FeatureExtractor> make_extractor(const StepPlan& plan, const FeatureExtractorFactory& factory) {
  if (!plan.wants("features")) return nullptr;
  if (!factory) throw NotSupportedError("", "--features", "features in this program");
  return factory(plan.features);
}

std::vector<PlannedStep> planned_steps(const StepPlan& plan, std::shared_ptr<const FeatureExtractor> extractor) {
  const bool features = plan.wants("features") && extractor != nullptr;
  const bool need_views = features && extractor->needs_views();
  std::vector<PlannedStep> steps;
  const auto add = [&](std::unique_ptr<Step> step, bool asked) { steps.push_back({std::move(step), asked}); };
  if (plan.wants("skeleton")) add(std::make_unique<SkeletonStep>(), true);
  if (plan.wants("asset")) add(std::make_unique<KeepAssetStep>(), true);
  if (plan.wants("voxels") || features) add(std::make_unique<VoxelStep>(plan.resolution), true);
  if (plan.wants("views") || need_views) {
    add(std::make_unique<ViewStep>(with_count(plan.views, kPublishedViews, plan.seed)), plan.wants("views"));
  }
  if (plan.wants("cond_views")) {
    add(std::make_unique<ConditionViewStep>(with_count(plan.condition_views, kPublishedConditionViews, plan.seed)),
        true);
  }
  if (features) add(std::make_unique<FeatureStep>(std::move(extractor), plan.resolution), true);
  return steps;
}

}  // namespace anigen::prepare
