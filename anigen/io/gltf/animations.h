#pragma once
#include <string>
#include <vector>

#include "anigen/asset/animation.h"
#include "anigen/io/gltf/container.h"
#include "anigen/io/gltf/document.h"
#include "anigen/io/gltf/rig.h"

namespace anigen::io::gltf_import {

/// Keyframes of one property of one node, as in the file but sound: times finite, ≥ 0, strictly increasing, values
/// finite, rotations of unit length (for LINEAR and STEP).
struct Track {
  int node = 0;
  ChannelPath path = ChannelPath::kTranslation;
  Interpolation interpolation = Interpolation::kLinear;
  std::vector<double> times, values;  ///< laid out as in anigen::Channel
};

struct TrackSet {
  std::string name;
  std::vector<Track> tracks;
};

/// Reads every animation. Keys that break the rules are dropped and noted ("repaired_keyframes"), as are second
/// channels for one property. @throws InputError when the animations together have too many values
std::vector<TrackSet> read_tracks(const Document& document, Notes& notes);

/// For a mesh without joints: what its file animates.
std::vector<NodeClip> clips_of_nodes(const std::vector<TrackSet>& animations);

/// Per node: whether some animation moves it away from the transform it rests in. Exporters often write constant
/// tracks for nodes that never move.
std::vector<char> moving_nodes(const Document& document, const std::vector<TrackSet>& animations);

/// Tracks of nodes as channels of joints, with the nodes folded into a joint applied to its keys and tangents (exact,
/// since they are similarities). Tracks of other nodes are dropped and noted.
std::vector<Animation> convert_animations(const std::vector<TrackSet>& animations, const Rig& rig, Notes& notes);

}  // namespace anigen::io::gltf_import
