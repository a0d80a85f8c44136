#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/config.h"
#include "anigen/motions/built_in.h"

namespace anigen::motions {

/// Rigged files to animate.
struct AnimateRequest {
  std::filesystem::path assets;      ///< .glb .gltf .fbx .dae, or a folder of them
  std::filesystem::path out;         ///< a file for a file, a folder for a folder: the same path below it
  std::string format = "glb";        ///< of the files in a folder, one of io::rigged_format_words()
  std::vector<std::string> motions;  ///< words of built_in_motions() and FILE[#CLIP]
  bool t_pose = false;               ///< a clip of one frame, before the motions
  bool keep_clips = true;            ///< clips that a file has stay, before the new ones
  MotionOptions options;
  std::filesystem::path pictures;  ///< a .png: frames of the first new clip on one sheet; else a folder for numbered
                                   ///< frames; of several assets: in a folder per asset; empty: none
};

struct ClipReport {
  std::string name;
  std::size_t frames = 0;
  double seconds = 0.0;
  std::string how;      ///< "built-in", "by limbs", "by transport of bones"
  double slide = -1.0;  ///< foot_slide(); negative where no foot stands
};

struct AnimateReport {
  std::filesystem::path asset, file;
  std::string failure;  ///< empty: there is a file
  std::string limbs;    ///< describe()
  std::vector<ClipReport> clips;
  bool copied = false;  ///< the clips were added to a copy of the file; else it was written anew
  std::vector<std::string> notes;
  double seconds = 0.0;
};

/// Animates every asset. One that fails is reported and does not stop the others; files are written by rename.
/// @throws InputError for options out of range, a motion that is neither a word nor a file, nothing to read, or a
/// result that would replace an input or whose extension is no format for assets, before any work; WriteError when the
/// disk refuses; Interrupted after Ctrl-C
std::vector<AnimateReport> animate_files(const AnimateRequest& request);

Json to_json(const std::vector<AnimateReport>& reports);
std::string to_text(const std::vector<AnimateReport>& reports);

/// Clips for an asset in memory, one per motion, words as AnimateRequest::motions; their names differ from those of its
/// own clips. @throws InputError for a motion that is neither a word nor a file, or that the body cannot do, and for
/// options out of their ranges; Interrupted
std::vector<Animation> clips_of(const Asset& asset, const std::vector<std::string>& motions,
                                const MotionOptions& options);

/// Contents of a file: the parts of its body, motions that this can do, and clips with their lengths. A file without a
/// skin has clips alone. @throws InputError as the readers
Json listing(const std::filesystem::path& file);
std::string listing_text(const Json& listing);

}  // namespace anigen::motions
