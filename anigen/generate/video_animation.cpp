#include "anigen/generate/video_animation.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/process.h"
#include "anigen/core/version.h"
#include "anigen/generate/picture_input.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/io/write_rigged.h"
#include "anigen/motions/animated_file.h"
#include "anigen/render/cameras_json.h"
#include "anigen/tracking/preview.h"

namespace anigen::generate {

namespace {

namespace fs = std::filesystem;

constexpr double kUsualFps = 30.0;
constexpr std::int64_t kFitSize = 64;  // pixels on a side while a camera is fitted
constexpr double kPoorOverlap = 0.5;

void check_video_request(const VideoAnimationRequest& request) {
  if (!io::is_rigged_output(request.out))
    throw InputError(request.out.string(), "--output", "an animated asset is a .glb, .gltf, .fbx, .usda or .usdz");
  if (!request.sheet.empty() && !io::has_extension(request.sheet, {".png"}))
    throw InputError(request.sheet.string(), "--turntable", "of a video one sheet is drawn: name a .png");
  if (request.fps != 0.0) require_between(request.fps, 1.0, 240.0, "--fps");
  std::vector<fs::path> outputs{request.out};
  if (!request.sheet.empty()) outputs.push_back(request.sheet);
  refuse_to_overwrite(outputs, [&] {
    std::vector<fs::path> inputs = io::files_read_with(request.asset);
    std::error_code error;
    if (!fs::is_directory(request.video, error)) inputs.push_back(request.video);
    return inputs;
  });
}

std::optional<render::Transforms> cameras_beside(const fs::path& video) {
  std::error_code error;
  const fs::path file = video / "transforms.json";
  if (!fs::is_directory(video, error) || !fs::exists(file, error)) return std::nullopt;
  return render::read_transforms(file);
}

/// Frames as objects on transparent ground, in squares.
std::vector<tracking::TrackedFrame> cut_frames(const VideoAnimationRequest& request, const tracking::Video& video,
                                               bool with_cameras, std::vector<std::string>& notes) {
  PreprocessingOptions options;
  options.background = request.background;
  options.matting = request.matting;
  options.normals = NormalSource::kColors;
  ImagePreprocessor preprocessor(options);
  std::vector<tracking::TrackedFrame> frames;
  Progress progress("reading", video.frames.size(), "frames");
  for (std::size_t n = 0; n < video.frames.size(); ++n) {
    throw_if_interrupted();
    std::vector<std::string> notices;
    io::Image object = preprocessor.object_of({video.frames[n], video.names[n]}, notices);
    if (n == 0) notes.insert(notes.end(), notices.begin(), notices.end());
    if (with_cameras && object.width != object.height) {
      throw InputError(video.names[n], "",
                       "frames with cameras of a transforms.json are square, this one is " +
                           std::to_string(object.width) + " x " + std::to_string(object.height));
    }
    frames.push_back({tracking::squared(object), video.names[n], {}});
    progress.advance();
  }
  progress.finish();
  return frames;
}

/// Brings the asset into the cameras' frame and gives every frame its camera.
Similarity set_cameras(const std::optional<render::Transforms>& transforms, Asset& asset,
                       std::vector<tracking::TrackedFrame>& frames) {
  if (!transforms) return normalize(asset);
  const Similarity normalisation{transforms->scale, transforms->offset};
  apply(normalisation, asset);
  for (std::size_t n = 0; n < frames.size(); ++n) frames[n].camera = tracking::pinhole(transforms->frames[n]);
  return normalisation;
}

std::string fit_one_camera(const tracking::RigTensors& rig, std::vector<tracking::TrackedFrame>& frames,
                           std::vector<std::string>& notes) {
  const tracking::FittedCamera fitted =
      tracking::fit_camera(rig, tracking::frame_level(frames.front().image, kFitSize, frames.front().name));
  for (tracking::TrackedFrame& frame : frames) frame.camera = fitted.camera;
  char text[120];
  std::snprintf(text, sizeof text, "fitted: yaw %.0f, pitch %.0f degrees, overlap of the bind pose %.2f",
                fitted.yaw_degrees, fitted.pitch_degrees, fitted.overlap);
  if (fitted.overlap < kPoorOverlap) {
    notes.emplace_back(
        "the rig in its bind pose covers little of the first frame: begin the video near that pose, seen from the "
        "front, "
        "or give cameras by a transforms.json");
  }
  return text;
}

}  // namespace

VideoAnimationReport animate_from_video(const VideoAnimationRequest& request) {
  check_video_request(request);
  VideoAnimationReport report;
  report.asset = request.asset;
  report.file = request.out;
  Asset asset = motions::read_animated(request.asset).asset;
  const std::optional<render::Transforms> transforms = cameras_beside(request.video);
  std::vector<std::string> names;
  if (transforms) {
    for (const render::Frame& frame : transforms->frames) names.push_back(frame.file_path);
  }
  Asset moved = asset;
  tracking::Video video = tracking::read_video(request.video, names);
  std::vector<tracking::TrackedFrame> frames = cut_frames(request, video, transforms.has_value(), report.notes);
  const Similarity normalisation = set_cameras(transforms, moved, frames);
  const tracking::RigTensors rig = tracking::rig_tensors(moved);
  report.camera = transforms ? "of transforms.json" : fit_one_camera(rig, frames, report.notes);
  report.fps = request.fps > 0.0 ? request.fps : video.fps > 0.0 ? video.fps : kUsualFps;

  Progress progress("tracking", tracking::track_steps(frames.size(), request.tracking), "steps");
  const tracking::TrackedPoses poses =
      tracking::track(rig, frames, request.tracking, [&progress] { progress.advance(); });
  progress.finish();
  report.seconds = poses.seconds;
  report.frames = frames.size();
  for (const double overlap : poses.overlaps) report.overlap += overlap / static_cast<double>(frames.size());
  const auto worst = std::min_element(poses.overlaps.begin(), poses.overlaps.end());
  report.worst = *worst;
  report.worst_frame = static_cast<std::size_t>(worst - poses.overlaps.begin());
  report.clip = (request.video / "x").parent_path().filename().stem().string();
  if (report.clip.empty()) report.clip = "video";
  const Animation clip = tracking::clip_of(poses, asset.skeleton, normalisation, report.fps, report.clip);
  if (!request.sheet.empty()) {
    const Animation here = tracking::clip_of(poses, moved.skeleton, {}, report.fps, report.clip);
    io::write_png(request.sheet, tracking::comparison_sheet(moved, rig, frames, poses, here, report.fps));
  }
  report.copied = motions::write_animated(request.asset, asset, {clip}, request.keep_clips, request.out, report.notes);
  return report;
}

Json to_json(const VideoAnimationReport& report) {
  Json json = {{"made_by", made_by()},          {"asset", report.asset.string()},
               {"file", report.file.string()},  {"clip", report.clip},
               {"frames", report.frames},       {"fps", report.fps},
               {"camera", report.camera},       {"overlap", report.overlap},
               {"worst_overlap", report.worst}, {"worst_frame", report.worst_frame},
               {"seconds", report.seconds},     {"copied", report.copied}};
  if (!report.notes.empty()) json["notes"] = report.notes;
  return json;
}

std::string to_text(const VideoAnimationReport& report) {
  char line[400];
  std::snprintf(line, sizeof line,
                "  %.60s: %zu frames at %.3g a second, tracked in %.1f s\n"
                "  overlap of silhouettes %.3f, at worst %.3f in frame %zu\n",
                report.clip.c_str(), report.frames, report.fps, report.seconds, report.overlap, report.worst,
                report.worst_frame);
  std::string text =
      report.asset.string() + ": " + report.file.string() + "\n" + line + "  camera " + report.camera + "\n";
  for (const std::string& note : report.notes) text += "  " + note + "\n";
  return text;
}

}  // namespace anigen::generate
