#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/generate/preprocess.h"
#include "anigen/tracking/track.h"

namespace anigen::generate {

/// A rig to be moved as the object in a video moves.
struct VideoAnimationRequest {
  std::filesystem::path asset;  ///< .glb .gltf .fbx .dae
  std::filesystem::path video;  ///< a folder of pictures by name, with transforms.json or without; or a video file
  std::filesystem::path out;    ///< .glb .gltf .fbx .usda .usdz
  std::filesystem::path sheet;  ///< .png of frames beside the tracked rig; empty: none
  double fps = 0.0;             ///< of the video; 0: what its file says, else 30
  bool keep_clips = true;       ///< clips that the asset has stay, before the new one
  Background background = Background::kAuto;
  MattingOptions matting;
  tracking::TrackOptions tracking;
};

struct VideoAnimationReport {
  std::filesystem::path asset, file;
  std::string clip;
  std::size_t frames = 0;
  double fps = 0.0;
  std::string camera;    ///< "of transforms.json", or the angles of the fitted one
  double overlap = 0.0;  ///< mean intersection over union of silhouettes
  double worst = 0.0;    ///< the least of them
  std::size_t worst_frame = 0;
  double seconds = 0.0;  ///< of tracking
  bool copied = false;   ///< the clip was added to a copy of the file; else it was written anew
  std::vector<std::string> notes;
};

/// Tracks the rig's pose through the video (tracking::track()) and writes the asset with that clip, named after the
/// video. Frames with transparency are taken as they are; of others the background is removed as for
/// ImagePreprocessor. A transforms.json beside the frames gives each its camera, in the frame that its scale and offset
/// lead to; otherwise one camera is fitted to the first frame.
/// @throws InputError for an asset without a rig, frames that cannot be read, are of different size or show nothing,
/// cameras that are not finite or do not see the rig, and a result that would replace an input; before any file is
/// written. Interrupted after Ctrl-C
VideoAnimationReport animate_from_video(const VideoAnimationRequest& request);

Json to_json(const VideoAnimationReport& report);
std::string to_text(const VideoAnimationReport& report);

}  // namespace anigen::generate
