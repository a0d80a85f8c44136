#include "anigen/studio/job_work.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/text.h"
#include "anigen/engine/animate.h"
#include "anigen/engine/files.h"
#include "anigen/engine/render.h"
#include "anigen/engine/rig.h"

namespace anigen::studio {

namespace {

namespace fs = std::filesystem;

constexpr std::uintmax_t kLargestInput = std::uintmax_t{1} << 30;
constexpr int kPreviewSide = 320;

std::string preview_of(const Asset& asset) {
  engine::RenderOptions options;
  options.width = options.height = kPreviewSide;
  options.transparent = true;
  return engine::png_bytes(engine::render(asset, options));
}

Json figures_of(const Asset& asset) {
  Json clips = Json::array();
  for (const Animation& clip : asset.animations) clips.push_back(as_utf8(clip.name));
  return {{"vertices", asset.mesh.vertices.size()},
          {"faces", asset.mesh.faces.size()},
          {"joints", asset.skeleton.size()},
          {"clips", clips}};
}

std::string input_bytes(const fs::path& folder, const JobRecord& record, const std::string& part) {
  return read_file(folder / record.inputs.at(part), kLargestInput);
}

/// An upload as an asset, called as its file.
Asset input_asset(const fs::path& folder, const JobRecord& record, const std::string& part) {
  Asset asset = engine::load_bytes(input_bytes(folder, record, part), record.inputs.at(part));
  asset.name = fs::path(record.names.at(part)).stem().string();
  return asset;
}

Asset rigged(const fs::path& folder, const JobOptions& options, Job& job, JobRecord& record) {
  job.report("reading", 0.0);
  const Asset mesh = input_asset(folder, record, "file");
  if (keeps_joints(options.rig.method) && mesh.skeleton.size() == 0)
    throw InputError(record.name, "", "has no joints, which method " + options.rig.method + " needs; auto finds some");
  engine::Rigged made = engine::rig(mesh, options.rig, &job);
  record.note = made.note;
  return std::move(made.asset);
}

bool has_clip(const Asset& asset, const std::string& name) {
  return std::any_of(asset.animations.begin(), asset.animations.end(),
                     [&](const Animation& clip) { return clip.name == name; });
}

/// The clip of an uploaded motion, under the name of its file.
void add_uploaded_motion(const fs::path& folder, const JobOptions& options, Job& job, const JobRecord& record,
                         Asset& asset) {
  engine::AnimateOptions animate = options.animate;
  animate.motions = {(folder / record.inputs.at("motion")).string()};
  const std::string stem = fs::path(record.names.at("motion")).stem().string();
  for (Animation& clip : engine::animate(asset, animate, &job)) {
    clip.name = stem;  // uploaded_clip() looks for it
    for (int again = 2; has_clip(asset, clip.name); ++again) clip.name = stem + "_" + std::to_string(again);
    asset.animations.push_back(std::move(clip));
  }
}

/// Place among the clips of a rig of the one that an uploaded motion became; their number: it has none.
std::size_t uploaded_clip(const JobRecord& record, const Asset& rig) {
  const std::string stem = fs::path(record.names.at("motion")).stem().string(), numbered = stem + "_";
  for (std::size_t i = rig.animations.size(); i-- > 0;) {  // it came behind the file's own
    const std::string& name = rig.animations[i].name;
    const bool is_numbered =
        name.rfind(numbered, 0) == 0 && name.find_first_not_of("0123456789", numbered.size()) == std::string::npos;
    if (name == stem || is_numbered) return i;
  }
  return rig.animations.size();
}

Asset animated(const fs::path& folder, const JobOptions& options, Job& job, JobRecord& record) {
  job.report("reading", 0.0);
  Asset asset = input_asset(folder, record, "file");
  if (asset.skeleton.size() == 0 || asset.skin.rows() == 0)
    throw InputError(record.name, "", "has no joints or no weights; give it a rig first");
  if (record.inputs.count("motion") == 0) return asset;
  job.report("motions", 0.0);
  add_uploaded_motion(folder, options, job, record, asset);
  return asset;
}

Json scored(const fs::path& folder, const JobOptions& options, Job& job, const JobRecord& record) {
  job.report("reading", 0.0);
  const Asset predicted = input_asset(folder, record, "file"), truth = input_asset(folder, record, "truth");
  const engine::Scores scores = engine::evaluate(predicted, truth, options.evaluate, &job);
  return {{"values", scores.values}, {"not_computed", scores.not_computed}, {"notes", scores.notes}};
}

}  // namespace

std::string as_utf8(const std::string& text) {
  return Json::parse(Json(text).dump(-1, ' ', false, Json::error_handler_t::replace)).get<std::string>();
}

JobOptions options_of(const JobRecord& record) {
  JobOptions options = parse_job_options(record.options, record.kind);
  if (record.inputs.count("motion") > 0) options.all_motions = false;
  return options;
}

void add_uploaded_clip(const fs::path& folder, const JobRecord& record, const Asset& rig, Asset& edit) {
  const std::size_t place = uploaded_clip(record, rig);
  if (place == rig.animations.size() || has_clip(edit, rig.animations[place].name)) return;
  const std::string& name = rig.animations[place].name;
  const std::string clip_word = name.find('#') == std::string::npos ? name : std::to_string(place);
  engine::AnimateOptions animate = options_of(record).animate;
  animate.motions = {(folder / kRiggedFile).string() + "#" + clip_word};
  for (Animation& clip : engine::animate(edit, animate)) {
    clip.name = name;
    edit.animations.push_back(std::move(clip));
  }
}

std::vector<Animation> clips_of(const Asset& asset, const JobOptions& options, Job* job) {
  engine::AnimateOptions animate = options.animate;
  animate.motions.clear();
  for (const std::string& motion : options.all_motions ? engine::motions_of(asset) : options.motions)
    if (!has_clip(asset, motion)) animate.motions.push_back(motion);
  return animate.motions.empty() ? std::vector<Animation>() : engine::animate(asset, animate, job);
}

/// @return nothing when it was to stop at its voxels
std::optional<Asset> JobWork::generated(const fs::path& folder, const JobOptions& options, Job& job,
                                        JobRecord& record) {
  if (!generator_) generator_ = std::make_unique<engine::Generator>(engine::GeneratorOptions(), &job);
  engine::GenerateOptions generate = options.generate;
  if (record.inputs.count("mask") > 0) generate.mask = input_bytes(folder, record, "mask");
  if (record.inputs.count("voxels") > 0) generate.voxels = input_bytes(folder, record, "voxels");
  generate.pictures = [&folder](const std::string& name, const std::string& png) {
    write_file_atomically(folder / (name + ".png"), png);
  };
  engine::Generated made = generator_->generate_bytes(input_bytes(folder, record, "file"), generate, &job);
  record.note = joined(made.notices, "; ");
  if (!made.voxels.empty()) write_file_atomically(folder / kVoxelsFile, made.voxels);
  if (generate.stop_at.empty()) return std::move(made.asset);
  if (made.voxels.empty()) throw Error("the generator gave no voxels to stop at");
  return std::nullopt;
}

void JobWork::run(const fs::path& folder, Job& job, JobRecord& record) {
  const JobOptions options = options_of(record);
  const double started = seconds_now();
  std::optional<Asset> asset;
  if (record.kind == "generation") asset = generated(folder, options, job, record);
  if (record.kind == "rig") asset = rigged(folder, options, job, record);
  if (record.kind == "animation") asset = animated(folder, options, job, record);
  if (record.kind == "evaluation") record.scores = scored(folder, options, job, record);
  if (asset) {
    asset->name = fs::path(record.name).stem().string();
    // Clips of the file stay; those made here come behind them.
    job.report("motions", 0.0);
    for (Animation& clip : clips_of(*asset, options, &job)) asset->animations.push_back(std::move(clip));
    job.report("writing", 0.0);
    write_file_atomically(folder / kPreviewFile, preview_of(*asset));
    engine::save(*asset, folder / kRiggedFile);
    record.result = figures_of(*asset);
  }
  record.note = as_utf8(record.note);
  record.result["seconds"] = std::round((seconds_now() - started) * 1000.0) / 1000.0;
}

}  // namespace anigen::studio
