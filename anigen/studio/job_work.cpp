#include "anigen/studio/job_work.h"

#include <algorithm>
#include <cmath>
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
constexpr double kClipRate = 24.0;  // key frames per second of the clips that come along
constexpr int kPreviewSide = 320;

std::string preview_of(const Asset& asset) {
  engine::RenderOptions options;
  options.width = options.height = kPreviewSide;
  options.transparent = true;
  return engine::png_bytes(engine::render(asset, options));
}

Json figures_of(const Asset& asset, double seconds) {
  Json clips = Json::array();
  for (const Animation& clip : asset.animations) clips.push_back(as_utf8(clip.name));
  return {{"vertices", asset.mesh.vertices.size()},
          {"faces", asset.mesh.faces.size()},
          {"joints", asset.skeleton.size()},
          {"clips", clips},
          {"seconds", std::round(seconds * 1000.0) / 1000.0}};
}

}  // namespace

std::string as_utf8(const std::string& text) {
  return Json::parse(Json(text).dump(-1, ' ', false, Json::error_handler_t::replace)).get<std::string>();
}

std::vector<Animation> clips_of(const Asset& asset, const JobOptions& options, Job* job) {
  engine::AnimateOptions animate;
  animate.fps = kClipRate;
  animate.motions.clear();
  for (const std::string& motion : options.all_motions ? engine::motions_of(asset) : options.motions) {
    const bool has = std::any_of(asset.animations.begin(), asset.animations.end(),
                                 [&](const Animation& clip) { return clip.name == motion; });
    if (!has) animate.motions.push_back(motion);
  }
  return animate.motions.empty() ? std::vector<Animation>() : engine::animate(asset, animate, job);
}

Asset JobWork::rigged(const fs::path& folder, const JobOptions& options, Job& job, JobRecord& record) {
  const std::string bytes = read_file(folder / record.input, kLargestInput);
  if (record.kind == "image") {
    if (!generator_) generator_ = std::make_unique<engine::Generator>(engine::GeneratorOptions(), &job);
    engine::Generated made = generator_->generate_bytes(bytes, options.generate, &job);
    record.note = joined(made.notices, "; ");
    return std::move(made.asset);
  }
  job.report("reading", 0.0);
  Asset mesh = engine::load_bytes(bytes, record.input);
  if (keeps_joints(options.rig.method) && mesh.skeleton.size() == 0)
    throw InputError(record.name, "", "has no joints, which method " + options.rig.method + " needs; auto finds some");
  engine::Rigged made = engine::rig(mesh, options.rig, &job);
  record.note = made.note;
  return std::move(made.asset);
}

void JobWork::run(const fs::path& folder, Job& job, JobRecord& record) {
  const JobOptions options = parse_job_options(record.options, record.kind);
  const double started = seconds_now();
  Asset asset = rigged(folder, options, job, record);
  asset.name = fs::path(record.name).stem().string();
  // Clips of the file stay; those made here come behind them.
  job.report("motions", 0.0);
  for (Animation& clip : clips_of(asset, options, &job)) asset.animations.push_back(std::move(clip));
  job.report("writing", 0.0);
  write_file_atomically(folder / kPreviewFile, preview_of(asset));
  engine::save(asset, folder / kRiggedFile);
  record.note = as_utf8(record.note);
  record.result = figures_of(asset, seconds_now() - started);
}

}  // namespace anigen::studio
