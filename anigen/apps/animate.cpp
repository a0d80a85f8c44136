#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/apps/animate_arguments.h"
#include "anigen/apps/common/command_line.h"
#include "anigen/apps/common/torch_half.h"
#include "anigen/core/error.h"
#include "anigen/core/text.h"
#include "anigen/engine/animate_request.h"

namespace {

using namespace anigen;

/// True for a pose that no motion follows.
bool wants_pose_alone(const CLI::App& app, const AnimateArguments& arguments) {
  return !arguments.pose.empty() && app.count("--motion") == 0;
}

/// Options that the motions asked for leave without effect.
/// Options that a list, a video or motions of files leave without effect, or cannot do without.
void refuse_ignored(const CLI::App& app, const AnimateArguments& arguments) {
  if (arguments.list) {
    return refuse_given(app,
                        {"--output", "--format", "--motion", "--pose", "--frames", "--fps", "--speed", "--travel",
                         "--drop-clips", "--turntable", "--keep-going", "--video", "--background", "--matting-network"},
                        "does not go with --list");
  }
  const bool films = !arguments.video.empty();
  if (films) {
    refuse_given(app, {"--motion", "--pose", "--frames", "--speed", "--travel", "--format", "--keep-going"},
                 "does not go with --video, whose motion one asset gets");
    if (arguments.background != "auto" && arguments.background != "network")
      refuse_given(app, {"--matting-network"}, "is not used by --background " + arguments.background);
  }
  if (arguments.request.out.empty())
    throw InputError("", "--output",
                     films ? "name the file to write" : "name the file or folder to write, or ask for --list");
  if (films) return;
  refuse_given(app, {"--background", "--matting-network"}, "applies only to the frames of a --video");
  const std::vector<std::string>& words = arguments.clips.motions;
  if (arguments.clips.frames > 0) refuse_given(app, {"--fps"}, "has no effect beside --frames");
  if (wants_pose_alone(app, arguments))
    refuse_given(app, {"--frames", "--fps", "--speed", "--travel"}, "has no effect on --pose alone");
  const bool travels = std::any_of(words.begin(), words.end(), motions::can_travel);
  if (!travels) refuse_given(app, {"--travel"}, "applies only to walk, run, swim, fly and slither");
}

void list(const AnimateArguments& arguments, const CommonOptions& common) {
  const Json found = motions::listing(arguments.asset);
  print_result(found, motions::listing_text(found), common);
}

void animate(const CLI::App& app, AnimateArguments& arguments, const CommonOptions& common) {
  motions::AnimateRequest& request = arguments.request;
  request.options = engine::motion_options(arguments.clips);
  if (!wants_pose_alone(app, arguments)) request.motions = arguments.clips.motions;
  request.assets = arguments.asset;
  request.pictures = arguments.pictures;
  request.t_pose = !arguments.pose.empty();
  request.keep_clips = !arguments.drop_clips;
  if (!std::filesystem::is_directory(arguments.asset))
    refuse_given(app, {"--format"}, "applies only to a folder; for one file the extension of --output says the format");
  const std::vector<motions::AnimateReport> reports = motions::animate_files(request);
  print_result(motions::to_json(reports), motions::to_text(reports), common);
  if (!std::filesystem::is_directory(arguments.asset) && !reports.front().failure.empty())
    throw InputError("", "", reports.front().failure);
  require_inputs(reports, "assets were not animated", common);
}

void animate_from_video(const CLI::App& app, AnimateArguments& arguments, const CommonOptions& common) {
  if (std::filesystem::is_directory(arguments.asset))
    throw InputError(arguments.asset, "--asset", "a video moves one asset: name a file");
  if (app.count("--fps") > 0) arguments.video_fps = arguments.clips.fps;
  torch_half("--video").animate_from_video(arguments, common);
}

}  // namespace

int main(int argc, char** argv) {
  Program program("anigen-animate",
                  "Moves rigged assets: motions that are built in, chosen by what limbs a body has, clips of other\n"
                  "files, or the motion of an object in a video. What else a .glb or .gltf holds stays as it is; FBX "
                  "and USD get base colours alone.",
                  "  anigen-animate fox.glb -o fox_idle.glb\n"
                  "  anigen-animate fox.glb --list\n"
                  "  anigen-animate fox.glb -o fox_moves.glb --motion walk --motion run --motion wag\n"
                  "  anigen-animate hero.glb -o dancer.glb --motion dance.bvh --turntable dancer.png\n"
                  "  anigen-animate hero.glb -o walker.glb --motion 'library.glb#Walk' --motion walk --travel\n"
                  "  anigen-animate hero.glb -o walker.fbx --motion walk\n"
                  "  anigen-animate hero.glb -o filmed.glb --video frames/ --turntable filmed.png\n"
                  "  anigen-animate rigged/ -o animated/ --motion idle --keep-going");
  program.first = "--asset";
  CLI::App& app = program.app;
  AnimateArguments arguments;
  engine::AnimateOptions& clips = arguments.clips;
  add_option(app, "--asset", arguments.asset)->required();
  add_option(app, "--motion", clips.motions,
             ", or a word: " + joined(motions::built_in_motions(), ", ", [](const auto& one) { return one.word; }) +
                 "; repeatable [idle]");
  add_option(app, "--video", arguments.video);
  add_option(app, "--background", arguments.background, " or network, as anigen-generate; of --video")
      ->check(one_of({"auto", "keep", "alpha", "grabcut", "network"}));
  add_option(app, "--matting-network", arguments.matting_network, "; of --video")->default_str("");
  add_option(app, "--pose", arguments.pose)->check(one_of({"T"}));
  add_option(app, "--list", arguments.list);
  add_option(app, "--frames", clips.frames)->check(whole_number(2, 10'000))->default_str("");
  add_option(app, "--fps", clips.fps)->check(number(1, 240));
  add_option(app, "--speed", clips.speed)->check(number(0.01, 100));
  add_option(app, "--travel", clips.travel);
  add_option(app, "--drop-clips", arguments.drop_clips);
  add_option(app, "--turntable", arguments.pictures, "; of a --video its frames above the rig that followed them");
  add_option(app, "--output", arguments.request.out, ": a file for a file, a folder for a folder");
  add_option(app, "--format", arguments.request.format);
  program.add_common({"--keep-going", "--threads", "--json"});
  program.check = [&] { refuse_ignored(app, arguments); };
  return program.run(argc, argv, [&] {
    if (arguments.list) return list(arguments, program.common);
    if (!arguments.video.empty()) return animate_from_video(app, arguments, program.common);
    animate(app, arguments, program.common);
  });
}
