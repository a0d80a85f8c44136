#include "anigen/prepare/steps.h"

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <system_error>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/hash.h"
#include "anigen/core/random.h"
#include "anigen/geometry/voxelize.h"
#include "anigen/io/arrays/npz.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/image.h"
#include "anigen/io/ply.h"
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
  for (const geometry::Voxel& voxel : voxels)
    centers.vertices.push_back(geometry::voxel_center(voxel, resolution).cast<float>());
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

namespace {

namespace fs = std::filesystem;

/// Of the form of the file itself; what steps make is versioned by each step.
constexpr int kFormat = 2;

constexpr char kFeatures[] = "features/";

Step voxel_step(int resolution) {
  Step step{"voxels"};
  step.options = {{"resolution", resolution}};
  step.outputs = [](const AssetPlaces& places, const Json&) {
    return Step::Files{places.surface_voxels(), places.skeleton_voxels()};
  };
  step.run = [resolution](AssetJob& job) -> Json {
    const Asset& asset = job.asset();
    const auto surface = geometry::voxelize_surface(asset.mesh.vertices, asset.mesh.faces, resolution);
    const auto skeleton = geometry::voxelize_bones(asset.skeleton.positions(), asset.skeleton.parents, resolution);
    write_voxel_ply(job.places().surface_voxels(), surface, resolution);
    write_voxel_ply(job.places().skeleton_voxels(), skeleton, resolution);
    job.forget_voxels();
    return {{"num_voxels", surface.size()}, {"num_skeleton_voxels", skeleton.size()}};
  };
  return step;
}

Step skeleton_step() {
  Step step{"skeleton"};
  step.outputs = [](const AssetPlaces& places, const Json&) { return Step::Files{places.skeleton()}; };
  step.run = [](AssetJob& job) {
    write_skeleton_archive(job.places().skeleton(), job.asset());
    return Json::object();
  };
  return step;
}

Step asset_step() {
  Step step{"asset"};
  step.outputs = [](const AssetPlaces& places, const Json&) { return Step::Files{places.asset()}; };
  step.run = [](AssetJob& job) {
    io::ExportOptions exported;
    exported.influences = std::max<std::size_t>(1, job.asset().skin.largest_row());
    io::write_gltf(job.places().asset(), job.asset(), exported);
    return Json::object();
  };
  return step;
}

Json write_features(AssetJob& job, const FeatureExtractor& extractor, int resolution) {
  const std::vector<geometry::Voxel>& voxels = job.surface_voxels(resolution);
  const FeatureRequest request{job.asset(), voxels, resolution,
                               extractor.needs_views() ? job.places().views() : fs::path()};
  io::NdArray features = extractor.extract(request);
  const auto rows = static_cast<std::int64_t>(voxels.size());
  if (features.dtype != io::Dtype::kF16 || features.shape != std::vector<std::int64_t>{rows, extractor.channels()})
    throw Error("feature extractor " + extractor.name() + " gave another shape or type than it announces");
  std::vector<std::uint8_t> indices;
  indices.reserve(3 * voxels.size());
  for (const geometry::Voxel& voxel : voxels) {
    for (const std::int32_t coordinate : voxel) indices.push_back(static_cast<std::uint8_t>(coordinate));
  }
  io::write_npz(job.places().features(extractor.name()),
                {{"indices", io::NdArray::from(indices, {rows, 3})}, {"patchtokens", std::move(features)}});
  return {{"channels", extractor.channels()}};
}

Step feature_step(const std::shared_ptr<const FeatureExtractor>& extractor, int resolution) {
  if (resolution > 256)
    throw InputError("", "--voxel-resolution", "features index voxels by bytes: at most 256 with --features");
  Step step{kFeatures + extractor->name()};
  step.inputs.emplace_back("voxels");
  if (extractor->needs_views()) step.inputs.emplace_back("views");
  step.options = {{"model", extractor->fingerprint()}};
  step.outputs = [model = extractor->name()](const AssetPlaces& places, const Json&) {
    return Step::Files{places.features(model)};
  };
  step.run = [extractor, resolution](AssetJob& job) { return write_features(job, *extractor, resolution); };
  return step;
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

/// The options and folder that both kinds of views share.
Step view_step(const std::string& name, const ViewSettings& settings, fs::path (AssetPlaces::*folder)() const) {
  Step step{name};
  step.options = {{"count", settings.count},
                  {"size", settings.size},
                  {"samples", settings.samples_per_axis},
                  {"geometry", settings.geometry},
                  {"seed", settings.seed}};
  // Said only where it holds, so that the records of data sets made before there was a choice still fit.
  if (settings.front) step.options["front"] = true;
  step.folder = std::mem_fn(folder);
  return step;
}

Step feature_view_step(const ViewSettings& settings) {
  Step step = view_step("views", settings, &AssetPlaces::views);
  step.outputs = [](const AssetPlaces& places, const Json& options) {
    Step::Files files = view_files(places.views(), options, {"normal", "depth"});
    files.push_back(places.views() / "mesh.ply");
    return files;
  };
  step.run = [settings](AssetJob& job) -> Json {
    const fs::path folder = job.places().views();
    Rng rng = camera_rng(settings, "feature views", job.id());
    const double offset0 = rng.uniform(), offset1 = rng.uniform();
    Mesh plain;
    plain.vertices = job.asset().mesh.vertices;
    plain.faces = job.asset().mesh.faces;
    io::write_ply(folder / "mesh.ply", plain);
    render::ViewOptions options = view_options(settings);
    options.geometry = settings.geometry;
    render_views(job, options, render::feature_views(settings.count, offset0, offset1), folder,
                 [&](const render::ViewImages& images, const render::Frame&, std::size_t i) {
                   if (!settings.geometry) return;
                   io::write_png(folder / picture_name(i, "normal"), render::encode_world_normals(images));
                   write_bytes(folder / picture_name(i, "depth"), render::encode_depth_png(images));
                 });
    return {{"views", settings.count}};
  };
  return step;
}

Step condition_view_step(const ViewSettings& settings) {
  Step step = view_step("cond_views", settings, &AssetPlaces::condition_views);
  step.outputs = [](const AssetPlaces& places, const Json& options) {
    return view_files(places.condition_views(), options, {"normal", "depth"});
  };
  step.run = [settings](AssetJob& job) -> Json {
    const fs::path folder = job.places().condition_views();
    Rng rng = camera_rng(settings, "condition views", job.id());
    render::ViewOptions options = view_options(settings);
    options.mean_normal = options.geometry = settings.geometry;
    const auto cameras =
        settings.front ? render::front_views(settings.count, rng) : render::condition_views(settings.count, rng);
    render_views(job, options, cameras, folder,
                 [&](const render::ViewImages& images, const render::Frame& frame, std::size_t i) {
                   if (!settings.geometry) return;
                   io::write_png(folder / picture_name(i, "normal"), render::encode_condition_normals(images, frame));
                   write_bytes(folder / picture_name(i, "depth"), render::encode_depth_png(images));
                 });
    return {{"cond_views", settings.count}};
  };
  return step;
}

/// Views that the published system renders (docs/reference/training.md, 1.1), for `--only views` without a number.
constexpr std::size_t kPublishedViews = 150, kPublishedConditionViews = 24;

ViewSettings with_count(ViewSettings settings, std::size_t published, std::uint64_t seed) {
  if (settings.count == 0) settings.count = published;
  settings.seed = seed;
  return settings;
}

/// @param count, size options of the program
void check_views(const ViewSettings& settings, const std::string& count, const std::string& size) {
  // Three digits name the pictures of the published layout.
  if (settings.count > 1000) throw InputError("", count, "at most 1000 views");
  if (settings.size < 8 || settings.size > 4096) throw InputError("", size, "must lie in 8 … 4096 pixels");
  if (settings.samples_per_axis < 1 || settings.samples_per_axis > 16)
    throw InputError("", "--view-samples", "must lie in 1 … 16");
}

}  // namespace

bool StepRecords::has_all(const std::vector<std::string>& inputs) const {
  return std::all_of(inputs.begin(), inputs.end(), [this](const std::string& input) { return has(input); });
}

const Json& StepRecords::columns(const std::string& step) const {
  static const Json none = Json::object();
  const auto found = steps.find(step);
  return found == steps.end() ? none : found->second.columns;
}

std::string StepRecords::fingerprint(const std::string& step, int version, const Json& options,
                                     const std::vector<std::string>& inputs) const {
  Json parts = Json::array({step, version, options});
  for (const std::string& input : inputs) {
    const auto found = steps.find(input);
    if (found == steps.end()) throw Error("step " + step + " comes before its input " + input);
    parts.push_back(found->second.fingerprint);
  }
  return sha256(parts.dump());
}

void StepRecords::drop_stale() {
  const auto stale = [&](const std::string& name, const StepResult& result) {
    return !has_all(result.inputs) ||
           result.fingerprint != fingerprint(name, result.version, result.options, result.inputs);
  };
  for (bool changed = true; changed;) {
    changed = false;
    for (auto step = steps.begin(); step != steps.end();) {
      const bool drop = stale(step->first, step->second);
      changed = changed || drop;
      step = drop ? steps.erase(step) : std::next(step);
    }
  }
}

StepRecords read_step_records(const fs::path& file) {
  try {
    Json json = read_json(file);
    if (json.at("format").get<int>() != kFormat) return {};
    StepRecords records;
    for (auto& [name, step] : json.at("steps").items()) {
      step.emplace("commit", "");  // records of earlier versions have none
      step.get_to(records.steps[name]);
      if (!records.steps[name].columns.is_object()) return {};
    }
    return records;
  } catch (const std::exception&) {
    return {};
  }
}

void write_step_records(const fs::path& file, const std::string& id, const StepRecords& records) {
  const Json json = {{"format", kFormat}, {"id", id}, {"steps", records.steps}};
  // Names inside some files are not UTF-8; a record is, whatever it quotes.
  write_file_atomically(file, json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n");
}

AssetJob::AssetJob(AssetPlaces places, std::function<Asset()> load)
    : places_(std::move(places)), load_(std::move(load)) {}

const Asset& AssetJob::asset() {
  if (!asset_) asset_ = load_();
  return *asset_;
}

const std::vector<geometry::Voxel>& AssetJob::surface_voxels(int resolution) {
  if (!voxels_) voxels_ = read_voxel_ply(places_.surface_voxels(), resolution);
  return *voxels_;
}

void Step::clear(const AssetPlaces& places) const {
  for (const fs::path& path : folder ? Files{folder(places)} : outputs(places, options)) {
    std::error_code ignored;
    fs::remove_all(path, ignored);
  }
}

bool measure_files(const std::vector<fs::path>& files, StepResult& result) {
  result.files = files.size();
  result.bytes = 0;
  for (const fs::path& file : files) {
    std::error_code error;
    const std::uintmax_t size = fs::file_size(file, error);
    if (error) return false;
    result.bytes += size;
  }
  return true;
}

bool up_to_date(const Step& step, const AssetPlaces& places, const StepRecords& records) {
  const auto found = records.steps.find(step.name);
  if (found == records.steps.end() || !records.has_all(step.inputs)) return false;
  const StepResult& result = found->second;
  const Json& options = step.asked ? step.options : result.options;
  StepResult now;
  return result.fingerprint == records.fingerprint(step.name, step.version, options, step.inputs) &&
         measure_files(step.outputs(places, options), now) && now.files == result.files && now.bytes == result.bytes;
}

void reset_peak_memory() {
  // 5 resets the high-water mark: proc(5), /proc/[pid]/clear_refs.
  std::ofstream("/proc/self/clear_refs") << "5";
}

std::uint64_t peak_memory_bytes() {
  std::ifstream status("/proc/self/status");
  for (std::string word; status >> word;) {
    if (word != "VmHWM:") continue;
    std::uint64_t kibibytes = 0;
    status >> kibibytes;
    return kibibytes << 10;
  }
  return 0;
}

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
    throw InputError("", "--only",
                     "unknown step \"" + word + "\"" + (near.empty() ? "" : "; did you mean \"" + near + "\"?"));
  }
  if (wants("features") && features.model.empty()) throw InputError("", "--only", "features need --features MODEL");
  if (wants("augment") && variants == 0) throw InputError("", "--only", "augment needs --augment K");
  if (resolution < 2 || resolution > 1024) throw InputError("", "--voxel-resolution", "must lie in 2 … 1024");
  if (variants > 10000) throw InputError("", "--augment", "at most 10000 variants");
  check_views(views, "--views", "--view-size");
  check_views(condition_views, "--cond-views", "--cond-view-size");
  poses.validate();
  cleaning.validate();
}

void ViewSettings::fields(ConfigFields& f) {
  f("count", count, {0});
  f("size", size, {0});
  f("samples", samples_per_axis, {0});
  f("geometry", geometry);
  f("front", front);
}

void StepPlan::fields(ConfigFields& f) {
  f("steps", steps);
  f("keep_assets", keep_assets);
  f("resolution", resolution, {0});
  f.object("views", views);
  f.object("cond_views", condition_views);
  f.object("features", [&](ConfigFields& g) {
    g("model", features.model);
    g("weights", features.weights);
    g("device", features.device);
  });
  f("variants", variants, {0});
  f("own_motion", poses.own_motion);
  f("key_frames", poses.key_frames);
  f("pose_probability", poses.probability);
  f("pose_max_angle", poses.max_angle);
  f("pose_anisotropic_scale", poses.anisotropic_scale);
  f.object("cleaning", cleaning);
  // Seeds use all 64 bits.
  f.custom(
      "seed", {{"type", "integer"}}, [&](const Json& json) { json.get_to(seed); }, [&] { return Json(seed); });
}

std::shared_ptr<const FeatureExtractor> make_extractor(const StepPlan& plan, const FeatureExtractorFactory& factory) {
  if (!plan.wants("features")) return nullptr;
  if (!factory) throw NotSupportedError("", "--features", "features in this program");
  return factory(plan.features);
}

std::vector<Step> planned_steps(const StepPlan& plan, const std::shared_ptr<const FeatureExtractor>& extractor) {
  const bool features = plan.wants("features") && extractor != nullptr;
  std::vector<Step> steps;
  if (plan.wants("skeleton")) steps.push_back(skeleton_step());
  if (plan.wants("asset")) steps.push_back(asset_step());
  if (plan.wants("voxels") || features) steps.push_back(voxel_step(plan.resolution));
  if (plan.wants("views") || (features && extractor->needs_views())) {
    steps.push_back(feature_view_step(with_count(plan.views, kPublishedViews, plan.seed)));
    steps.back().asked = plan.wants("views");
  }
  if (plan.wants("cond_views"))
    steps.push_back(condition_view_step(with_count(plan.condition_views, kPublishedConditionViews, plan.seed)));
  if (features) steps.push_back(feature_step(extractor, plan.resolution));
  return steps;
}

std::vector<fs::path> recorded_files(const std::string& step, const Json& options, const AssetPlaces& places) {
  // A step's own options decide what is in its files; where they lie, the options of the record do.
  static const std::vector<Step> known{skeleton_step(), asset_step(), voxel_step(64), feature_view_step({}),
                                       condition_view_step({})};
  if (step.rfind(kFeatures, 0) == 0) return {places.features(step.substr(sizeof kFeatures - 1))};
  for (const Step& one : known) {
    if (one.name == step) return one.outputs(places, options);
  }
  return {};
}

}  // namespace anigen::prepare
