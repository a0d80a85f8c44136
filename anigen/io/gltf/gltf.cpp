#include "anigen/io/gltf/gltf.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <new>
#include <set>
#include <stdexcept>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/io/gltf/accessors.h"
#include "anigen/io/gltf/container.h"
#include "anigen/io/gltf/document.h"
#include "anigen/io/gltf/mesh.h"
#include "anigen/io/gltf/rig.h"

namespace anigen::io {

namespace gltf_import {

namespace {

/// Keyframes of one property of one node, as in the file but sound: times finite, ≥ 0, strictly increasing, values
/// finite, rotations of unit length (for LINEAR and STEP).
struct Track : Channel {  ///< without a joint yet
  int node = 0;
};

struct TrackSet {
  std::string name;
  std::vector<Track> tracks;
};

// Many channels can point at one accessor, so the file's size does not bound this.
constexpr std::size_t kMostValues = 50'000'000;

std::size_t width_of(ChannelPath path) { return path == ChannelPath::kRotation ? 4 : 3; }

// True when one key's values can be used; a LINEAR or STEP rotation is given unit length.
bool repair_values(const Track& track, double* values, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) {
    if (!std::isfinite(values[i])) return false;
  }
  if (track.path != ChannelPath::kRotation) return true;
  const bool cubic = track.interpolation == Interpolation::kCubicSpline;
  Eigen::Map<Eigen::Vector4d> rotation(values + (cubic ? 4 : 0));
  const double norm = rotation.norm();
  if (!(norm > 1e-9) || !std::isfinite(norm)) return false;
  // A spline's tangents belong to the values as they are.
  if (!cubic) rotation /= norm;
  return true;
}

Track read_track(const Document& document, const AnimationChannel& channel, std::size_t& dropped) {
  Track track;
  track.node = channel.node;
  track.path = channel.path;
  track.interpolation = channel.interpolation;
  const std::vector<double> times = read_doubles(document, channel.input);
  std::vector<double> values = read_doubles(document, channel.output);
  const std::size_t width = width_of(track.path) * (track.interpolation == Interpolation::kCubicSpline ? 3 : 1);
  for (std::size_t k = 0; k < times.size(); ++k) {
    const bool in_order =
        std::isfinite(times[k]) && times[k] >= 0.0 && (track.times.empty() || times[k] > track.times.back());
    double* key = values.data() + k * width;
    if (!in_order || !repair_values(track, key, width)) {
      ++dropped;
      continue;
    }
    track.times.push_back(times[k]);
    track.values.insert(track.values.end(), key, key + width);
  }
  return track;
}

bool is_constant_rest(const Track& track, const Transform& rest) {
  Eigen::Vector4d expected = Eigen::Vector4d::Zero();
  if (track.path == ChannelPath::kTranslation) expected.head<3>() = rest.translation;
  if (track.path == ChannelPath::kScale) expected.head<3>() = rest.scale;
  if (track.path == ChannelPath::kRotation) expected = rest.rotation.coeffs();
  const std::size_t width = width_of(track.path);
  const bool cubic = track.interpolation == Interpolation::kCubicSpline;
  // Float noise of an exporter, relative to the size of what is keyed.
  const double tolerance = 1e-5 * std::max(expected.norm(), 1e-3);
  for (std::size_t k = 0; k < track.times.size(); ++k) {
    const double* key = track.values.data() + k * width * (cubic ? 3 : 1);
    double plus = 0.0, minus = 0.0;
    for (std::size_t i = 0; i < width; ++i) {
      const double value = key[(cubic ? width : 0) + i];
      const double wanted = expected[static_cast<Eigen::Index>(i)];
      plus = std::max(plus, std::abs(value - wanted));
      minus = std::max(minus, std::abs(value + wanted));
      if (cubic && (std::abs(key[i]) > tolerance || std::abs(key[2 * width + i]) > tolerance)) return false;
    }
    // q and -q are the same rotation.
    if (plus > tolerance && (track.path != ChannelPath::kRotation || minus > tolerance)) return false;
  }
  return true;
}

// Every animation. Keys that break the rules are dropped and noted ("repaired_keyframes"), as are second channels for
// one property.
std::vector<TrackSet> read_tracks(const Document& document, Notes& notes) {
  std::vector<TrackSet> result;
  std::size_t values = 0, dropped = 0;
  for (const AnimationEntry& animation : document.animations) {
    TrackSet set;
    set.name = animation.name.empty() ? "animation_" + std::to_string(result.size()) : animation.name;
    std::set<std::pair<int, int>> seen;
    for (const AnimationChannel& channel : animation.channels) {
      if (!seen.emplace(channel.node, static_cast<int>(channel.path)).second) {
        notes.tally("dropped_channels", "animation channels repeated a property and were dropped");
        continue;
      }
      const Accessor& output = document.accessors[at(channel.output)];
      values += output.count * output.width;
      if (values > kMostValues) {
        throw InputError(document.file, channel.pointer,
                         "the animations have more than " + std::to_string(kMostValues) + " values");
      }
      Track track = read_track(document, channel, dropped);
      if (!track.times.empty()) set.tracks.push_back(std::move(track));
    }
    result.push_back(std::move(set));
  }
  notes.tally("repaired_keyframes", "keyframes with unusable times or values were dropped", dropped);
  return result;
}

// For a mesh without joints: what its file animates.
std::vector<NodeClip> clips_of_nodes(const std::vector<TrackSet>& animations) {
  std::vector<NodeClip> clips;
  for (const TrackSet& set : animations) {
    NodeClip clip{set.name, 0.0, set.tracks.size()};
    for (const Track& track : set.tracks) clip.seconds = std::max(clip.seconds, track.times.back());
    if (clip.tracks > 0) clips.push_back(std::move(clip));
  }
  return clips;
}

// Per node: whether some animation moves it away from the transform it rests in. Exporters often write constant tracks
// for nodes that never move.
std::vector<char> moving_nodes(const Document& document, const std::vector<TrackSet>& animations) {
  std::vector<char> moving(document.nodes.size(), 0);
  for (const TrackSet& animation : animations) {
    for (const Track& track : animation.tracks) {
      const auto node = static_cast<std::size_t>(track.node);
      if (moving[node] == 0 && !is_constant_rest(track, document.nodes[node].local)) moving[node] = 1;
    }
  }
  return moving;
}

// Applies `prefix` to a value, or to a tangent, which a translation does not move.
void apply(const FoldedTransform& prefix, ChannelPath path, bool is_tangent, double* value) {
  if (path == ChannelPath::kRotation) {
    Eigen::Map<Eigen::Vector4d> q(value);
    // Quaternion products are linear in q, so this holds for tangents and values that are not of unit length.
    const Eigen::Quaterniond product = prefix.rotation * Eigen::Quaterniond(q[3], q[0], q[1], q[2]);
    q = product.coeffs();
    return;
  }
  Eigen::Map<Eigen::Vector3d> v(value);
  if (path == ChannelPath::kScale)
    v = prefix.scale * v;
  else
    v = Eigen::Vector3d(prefix.scale * (prefix.rotation * v) +
                        (is_tangent ? Eigen::Vector3d(Eigen::Vector3d::Zero()) : prefix.translation));
}

Channel convert(const Track& track, int joint, const FoldedTransform& prefix) {
  Channel channel = track;
  channel.joint = joint;
  const std::size_t width = width_of(track.path);
  const bool cubic = track.interpolation == Interpolation::kCubicSpline;
  for (std::size_t i = 0; i < channel.values.size() / width; ++i)
    apply(prefix, track.path, cubic && i % 3 != 1, channel.values.data() + i * width);
  return channel;
}

// Tracks of nodes as channels of joints, with the nodes folded into a joint applied to its keys and tangents (exact,
// since they are similarities). Tracks of other nodes are dropped and noted.
std::vector<Animation> convert_animations(const std::vector<TrackSet>& animations, const Rig& rig, Notes& notes) {
  std::vector<Animation> result;
  for (const TrackSet& set : animations) {
    Animation animation;
    animation.name = set.name;
    for (const Track& track : set.tracks) {
      const int joint = rig.joint_of_node[at(track.node)];
      if (joint < 0) {
        notes.tally("dropped_channels", "animation channels of nodes that are not joints were dropped");
        continue;
      }
      animation.channels.push_back(convert(track, joint, rig.prefix[at(joint)]));
    }
    if (animation.channels.empty())
      notes.tally("empty_animation", "animations without channels on joints were left out");
    else
      result.push_back(std::move(animation));
  }
  return result;
}

// Pictures as encoded bytes, each once. One that is missing, or neither PNG nor JPEG, is left out and noted: an asset
// without its texture still is worth having.
class ImageReader {
 public:
  ImageReader(const Document& document, const std::filesystem::path& folder, const ImportOptions& options,
              std::vector<EncodedImage>& images, Notes& notes)
      : document_(document), folder_(folder), images_(images), notes_(notes), left_(options.max_file_bytes) {}

  // @return index into the images, or -1
  int get(int image) {
    const auto [known, is_new] = index_.try_emplace(image, -1);
    if (is_new) known->second = read(document_.images[at(image)]);
    return known->second;
  }

 private:
  // Empty when there is no such picture. Every read counts, since many entries can name one large file.
  std::string bytes_of(const ImageEntry& entry) {
    std::string bytes;
    if (entry.view >= 0) {
      bytes = document_.views[at(entry.view)].bytes;
    } else if (!entry.uri.empty()) {
      const std::string place = entry.pointer + "/uri";
      std::error_code error;
      if (!is_data_uri(entry.uri) &&
          !std::filesystem::exists(path_of_uri(entry.uri, folder_, document_.file, place), error))
        return {};
      bytes = read_uri(entry.uri, folder_, document_.file, place, left_);
    }
    if (bytes.size() > left_) throw InputError(document_.file, entry.pointer, "the images exceed the importer's limit");
    left_ -= bytes.size();
    return bytes;
  }

  int read(const ImageEntry& entry) {
    EncodedImage image;
    const std::string bytes = bytes_of(entry);
    if (bytes.empty()) {
      notes_.add("missing_image", "image '" + (entry.uri.empty() ? entry.name : entry.uri).substr(0, 80) +
                                      "' is not there: its material has no texture");
      return -1;
    }
    const char* mime_type = picture_mime_type(bytes);
    if (mime_type == nullptr) {
      notes_.add("unsupported_image", "image '" + (entry.name.empty() ? entry.pointer : entry.name).substr(0, 80) +
                                          "' is neither PNG nor JPEG: its material has no texture");
      return -1;
    }
    image.mime_type = mime_type;
    image.name = entry.name;
    if (image.name.empty() && entry.view < 0 && !is_data_uri(entry.uri))
      image.name = std::filesystem::path(entry.uri).stem().string();
    image.bytes.assign(bytes.begin(), bytes.end());
    images_.push_back(std::move(image));
    return static_cast<int>(images_.size()) - 1;
  }

  const Document& document_;
  const std::filesystem::path& folder_;
  std::vector<EncodedImage>& images_;
  Notes& notes_;
  std::uintmax_t left_;
  std::map<int, int> index_;
};

// All materials of the file, in its order, and the images that they show.
void add_materials(const Document& document, const std::filesystem::path& folder, const ImportOptions& options,
                   Asset& asset, Notes& notes) {
  // Refused even where no material uses them, so that a file is either sound or not.
  for (const ImageEntry& image : document.images) {
    if (!image.uri.empty() && !is_data_uri(image.uri))
      path_of_uri(image.uri, folder, document.file, image.pointer + "/uri");
  }
  ImageReader reader(document, folder, options, asset.images, notes);
  for (const MaterialEntry& entry : document.materials) {
    asset.materials.push_back(entry.material);
    const int texture = entry.base_color.texture;
    const int image = texture >= 0 ? document.texture_images[at(texture)] : -1;
    if (image >= 0) asset.materials.back().image = reader.get(image);
  }
}

}  // namespace

std::vector<char> moving_nodes(const Document& document, Notes& notes) {
  return moving_nodes(document, read_tracks(document, notes));
}

ImportedAsset document_asset(const Document& document, const std::filesystem::path& path, const ImportOptions& options,
                             Notes& notes) {
  const std::vector<TrackSet> tracks = read_tracks(document, notes);
  Rig rig = build_rig(document, moving_nodes(document, tracks), options, notes);
  const std::vector<SkinBinding> bindings = bind_skins(document, rig, notes);

  ImportedAsset result;
  Asset& asset = result.asset;
  asset.name = path.stem().string();
  MergedMesh merged = merge_meshes(document, rig, bindings, options, notes);
  asset.mesh = std::move(merged.mesh);
  asset.skin = std::move(merged.skin);
  add_materials(document, path.parent_path(), options, asset, notes);
  if (rig.skeleton.size() > 0)
    asset.animations = convert_animations(tracks, rig, notes);
  else
    result.node_clips = clips_of_nodes(tracks);
  asset.skeleton = std::move(rig.skeleton);
  result.frame = document.frame;
  const std::vector<std::string> findings = validate(asset, 1, options.require_rig);
  if (!findings.empty()) throw InputError(document.file, "", "cannot be made a sound asset: " + findings.front());
  result.notes = notes.take();
  result.lowest_weight_sum = notes.lowest_weight_sum();
  return result;
}

}  // namespace gltf_import

namespace {

/// @param read fills the container
ImportedAsset asset_of(const std::filesystem::path& path, const ImportOptions& options,
                       const std::function<void(gltf_import::Container&)>& read) {
  try {
    gltf_import::Notes notes;
    gltf_import::Container container;
    read(container);
    const gltf_import::Document document = gltf_import::parse_document(container, options, notes);
    return gltf_import::document_asset(document, path, options, notes);
  } catch (const std::bad_alloc&) {
    throw InputError(path.string(), "", "reading it needs more memory than there is");
  } catch (const std::length_error&) {
    throw InputError(path.string(), "", "reading it needs more memory than there is");
  }
}

}  // namespace

ImportedAsset read_gltf(const std::filesystem::path& path, const ImportOptions& options) {
  return asset_of(path, options,
                  [&](gltf_import::Container& container) { gltf_import::read_container(path, options, container); });
}

ImportedAsset read_gltf_bytes(std::string bytes, const std::string& name, const ImportOptions& options) {
  return asset_of(gltf_import::no_folder() / name, options, [&](gltf_import::Container& container) {
    container.file = name;
    container.folder = gltf_import::no_folder();
    if (bytes.size() > options.max_file_bytes)
      throw InputError(name, "", "holds more than " + std::to_string(options.max_file_bytes) + " bytes");
    gltf_import::split_container(std::move(bytes), options, container);
  });
}

}  // namespace anigen::io
