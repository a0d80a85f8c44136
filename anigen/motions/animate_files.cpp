#include "anigen/motions/animate_files.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <map>
#include <memory>
#include <set>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/process.h"
#include "anigen/core/text.h"
#include "anigen/core/version.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/rigs/bvh.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/io/write_rigged.h"
#include "anigen/motions/animated_file.h"
#include "anigen/motions/contact.h"
#include "anigen/motions/pictures.h"
#include "anigen/motions/retargeted.h"

namespace anigen::motions {

namespace {

namespace fs = std::filesystem;

struct Job {
  fs::path asset, file;
  std::string id;  ///< path below the folder, without extension
};

std::vector<Job> jobs_of(const AnimateRequest& request) {
  if (!fs::is_directory(request.assets)) {
    if (!io::is_rigged_output(request.out))
      throw InputError(request.out.string(), "--output", "an animated asset is a .glb, .gltf, .fbx, .usda or .usdz");
    return {{request.assets, request.out, request.assets.stem().string()}};
  }
  if (io::is_rigged_output(request.out) && !fs::is_directory(request.out))
    throw InputError(request.out.string(), "--output", "a file holds one asset; several go to a folder");
  std::vector<Job> jobs;
  for (const fs::path& file : io::files_below(request.assets, animated_extensions())) {
    const fs::path below = fs::path(file.lexically_relative(request.assets)).replace_extension("");
    jobs.push_back({file, request.out / (below.string() + "." + request.format), below.string()});
  }
  if (jobs.empty()) throw InputError(request.assets.string(), "", "there is no .glb, .gltf, .fbx or .dae in it");
  std::map<fs::path, fs::path> by_output;
  for (const Job& job : jobs) {
    const auto [known, is_new] = by_output.emplace(job.file, job.asset);
    if (!is_new) {
      throw InputError(job.asset.string(), "",
                       "would be written to one file with " + known->second.filename().string());
    }
  }
  return jobs;
}

/// Clips of other files are read once, for all assets.
std::vector<SourceClip> read_given(const AnimateRequest& request) {
  std::vector<SourceClip> given;
  for (const std::string& word : request.motions) {
    if (is_built_in(word)) {
      given.emplace_back();
      continue;
    }
    const std::string file = word.substr(0, word.rfind('#'));
    std::error_code ignored;
    if (!fs::exists(word, ignored) && !fs::exists(file, ignored) && fs::path(file).extension().empty()) {
      throw InputError("", "--motion",
                       "'" + word + "' is neither a file nor one of " +
                           joined(built_in_motions(), ", ", [](const auto& one) { return one.word; }));
    }
    given.push_back(read_clip(word, request.options));
  }
  return given;
}

void refuse_lost_inputs(const AnimateRequest& request, const std::vector<Job>& jobs) {
  std::vector<fs::path> outputs;
  for (const Job& job : jobs) outputs.push_back(job.file);
  if (!request.pictures.empty()) outputs.push_back(request.pictures);
  refuse_to_overwrite(outputs, [&] {
    std::vector<fs::path> inputs;
    for (const Job& job : jobs) {
      for (fs::path& file : io::files_read_with(job.asset)) inputs.push_back(std::move(file));
    }
    for (const std::string& word : request.motions) {
      if (is_built_in(word)) continue;
      inputs.push_back(word.substr(0, word.rfind('#')));
      inputs.emplace_back(word);  // a file whose name holds a #
    }
    return inputs;
  });
}

struct MadeClips {
  std::vector<Animation> clips;
  std::vector<ClipReport> reports;
};

void keep(const Body& body, const Skeleton& skeleton, const BodyMotion& motion, std::string how, MadeClips& made) {
  made.clips.push_back(to_clip(motion, skeleton));
  ClipReport report{made.clips.back().name, motion.times.size(), motion.times.back(), std::move(how), -1.0};
  const bool stands = std::any_of(motion.contacts.begin(), motion.contacts.end(), [](const FootContact& contact) {
    return std::find(contact.stands.begin(), contact.stands.end(), true) != contact.stands.end();
  });
  if (stands) report.slide = foot_slide(body, motion, made.clips.back(), skeleton);
  made.reports.push_back(std::move(report));
}

MadeClips make_clips(const Body& body, const Skeleton& skeleton, const AnimateRequest& request,
                     const std::vector<SourceClip>& given) {
  MadeClips made;
  if (request.t_pose) keep(body, skeleton, t_pose(body), "built-in", made);
  for (std::size_t i = 0; i < request.motions.size(); ++i) {
    throw_if_interrupted();
    if (is_built_in(request.motions[i])) {
      keep(body, skeleton, make_motion(body, request.motions[i], request.options), "built-in", made);
      continue;
    }
    Retargeted moved = retarget_to(body, given[i]);
    if (moved.motion.name.empty()) moved.motion.name = fs::path(request.motions[i]).stem().string();
    for (double& time : moved.motion.times) time /= request.options.speed;
    std::string how = moved.by_limbs ? "by limbs" : "by transport of bones";
    if (moved.raised >= 0.01) {
      char text[64];
      std::snprintf(text, sizeof text, ", raised by %.0f %% of the height", 100.0 * moved.raised);
      how += text;
    }
    keep(body, skeleton, moved.motion, std::move(how), made);
  }
  return made;
}

/// Clips are told apart by their names, among themselves and from those that the file keeps.
void give_own_names(const std::vector<Animation>& kept, MadeClips& made) {
  std::set<std::string> taken;
  for (const Animation& clip : kept) taken.insert(clip.name);
  for (std::size_t i = 0; i < made.clips.size(); ++i) {
    const std::string name = made.clips[i].name;
    for (int k = 2; !taken.insert(made.clips[i].name).second; ++k) made.clips[i].name = name + "_" + std::to_string(k);
    made.reports[i].name = made.clips[i].name;
  }
}

void draw(const AnimateRequest& request, const Job& job, bool several, const Asset& asset, const Animation& clip) {
  if (request.pictures.empty()) return;
  if (!io::has_extension(request.pictures, {".png"})) {
    return write_clip_frames(several ? request.pictures / job.id : request.pictures, asset, clip);
  }
  write_clip_sheet(request.pictures, asset, clip);
}

AnimateReport animate(const Job& job, const AnimateRequest& request, const std::vector<SourceClip>& given,
                      bool several) {
  AnimateReport report;
  report.asset = job.asset;
  report.file = job.file;
  Asset asset = read_animated(job.asset).asset;
  const Body body = analyse(asset);
  report.limbs = describe(body);
  MadeClips made = make_clips(body, asset.skeleton, request, given);
  give_own_names(request.keep_clips ? asset.animations : std::vector<Animation>(), made);
  report.clips = std::move(made.reports);
  draw(request, job, several, asset, made.clips.front());
  report.copied = write_animated(job.asset, asset, made.clips, request.keep_clips, job.file, report.notes);
  return report;
}

Json clips_json(const std::vector<Animation>& animations) {
  Json clips = Json::array();
  for (const Animation& animation : animations)
    clips.push_back({{"name", animation.name}, {"seconds", animation.duration()}});
  return clips;
}

}  // namespace

std::vector<AnimateReport> animate_files(const AnimateRequest& request) {
  check_options(request.options);
  AnimateRequest wanted = request;
  if (wanted.motions.empty() && !wanted.t_pose) wanted.motions = {"idle"};
  const std::vector<Job> jobs = jobs_of(wanted);
  const bool several = fs::is_directory(wanted.assets);
  if (several && io::has_extension(wanted.pictures, {".png"}))
    throw InputError(wanted.pictures.string(), "--turntable", "one sheet takes one asset; name a folder");
  refuse_lost_inputs(wanted, jobs);
  const std::vector<SourceClip> given = read_given(wanted);
  std::vector<AnimateReport> reports;
  Progress progress("animating", jobs.size(), "assets");
  for (const Job& job : jobs) {
    throw_if_interrupted();
    const auto started = std::chrono::steady_clock::now();
    AnimateReport report;
    try {
      report = animate(job, wanted, given, several);
    } catch (...) {
      report.asset = job.asset;
      report.file = job.file;
      report.failure = failure_of_item();
      log::warn("{}: {}", job.id, report.failure);
    }
    report.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
    reports.push_back(std::move(report));
    progress.advance();
  }
  progress.finish();
  return reports;
}

std::vector<Animation> clips_of(const Asset& asset, const std::vector<std::string>& motions,
                                const MotionOptions& options) {
  check_options(options);
  AnimateRequest request;
  request.motions = motions;
  request.options = options;
  MadeClips made = make_clips(analyse(asset), asset.skeleton, request, read_given(request));
  give_own_names(asset.animations, made);
  return std::move(made.clips);
}

Json to_json(const std::vector<AnimateReport>& reports) {
  Json list = Json::array();
  for (const AnimateReport& report : reports) {
    Json one = {{"asset", report.asset.string()}, {"file", report.file.string()}, {"seconds", report.seconds}};
    if (!report.failure.empty()) {
      one["failure"] = report.failure;
      list.push_back(std::move(one));
      continue;
    }
    one["limbs"] = report.limbs;
    one["copied"] = report.copied;
    one["clips"] = Json::array();
    for (const ClipReport& clip : report.clips) {
      Json entry = {{"name", clip.name}, {"frames", clip.frames}, {"seconds", clip.seconds}, {"how", clip.how}};
      if (clip.slide >= 0.0) entry["slide"] = clip.slide;
      one["clips"].push_back(std::move(entry));
    }
    if (!report.notes.empty()) one["notes"] = report.notes;
    list.push_back(std::move(one));
  }
  return {{"made_by", made_by()}, {"assets", std::move(list)}};
}

std::string to_text(const std::vector<AnimateReport>& reports) {
  std::string text;
  for (const AnimateReport& report : reports) {
    text += report.asset.string() + ": ";
    if (!report.failure.empty()) {
      text += report.failure + "\n";
      continue;
    }
    text += report.file.string() + ", " + report.limbs + "\n";
    for (const ClipReport& clip : report.clips) {
      char line[160];
      std::snprintf(line, sizeof line, "  %.60s: %zu frames, %.2f s, %s", clip.name.c_str(), clip.frames, clip.seconds,
                    clip.how.c_str());
      text += line;
      if (clip.slide >= 0.0) {
        std::snprintf(line, sizeof line, ", standing feet slide %.2f %% of the height", 100.0 * clip.slide);
        text += line;
      }
      text += "\n";
    }
    for (const std::string& note : report.notes) text += "  " + note + "\n";
  }
  return text;
}

Json listing(const fs::path& file) {
  io::require_content(file);
  if (io::has_extension(file, {".bvh"})) {
    const io::BvhMotion read = io::read_bvh(file);
    return {{"file", file.string()}, {"clips", clips_json({read.animation})}};
  }
  const io::ImportedAsset read = read_animated(file);
  Json result = {{"file", file.string()}, {"clips", clips_json(read.asset.animations)}};
  if (read.asset.mesh.vertices.empty() || read.asset.skin.rows() == 0) return result;
  const Body body = analyse(read.asset);
  result["limbs"] = describe(body);
  result["motions"] = motions_of(body);
  return result;
}

std::string listing_text(const Json& listing) {
  std::string text = listing.at("file").get<std::string>() + "\n";
  if (listing.contains("motions")) {
    text += "  body: " + listing.at("limbs").get<std::string>() + "\n  motions:\n";
    for (const Json& word : listing.at("motions")) {
      for (const BuiltInMotion& one : built_in_motions()) {
        if (word == one.word) text += "    " + std::string(one.word) + ": " + one.purpose + "\n";
      }
    }
  } else {
    text += "  no skinned mesh: a source of clips alone\n";
  }
  text += listing.at("clips").empty() ? "  clips: none\n" : "  clips:\n";
  std::size_t number = 0;
  for (const Json& clip : listing.at("clips")) {
    char seconds[32];
    std::snprintf(seconds, sizeof seconds, ", %.2f s\n", clip.at("seconds").get<double>());
    text += "    #" + std::to_string(number++) + " " + clip.at("name").get<std::string>() + seconds;
  }
  return text;
}

}  // namespace anigen::motions
