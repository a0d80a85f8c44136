#include "anigen/io/gltf/add_animations.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <new>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/numeric.h"
#include "anigen/io/gltf/container.h"
#include "anigen/io/gltf/document.h"
#include "anigen/io/gltf/export.h"
#include "anigen/io/gltf/graft_file.h"
#include "anigen/io/gltf/rig.h"

namespace anigen::io {

namespace gltf_import {

namespace {

/// A transform before which what stands in `prefix` was folded away again: prefix · result = transform.
Transform unfolded(const FoldedTransform& prefix, const Transform& transform) {
  Transform result;
  result.translation = prefix.rotation.conjugate() * (transform.translation - prefix.translation) / prefix.scale;
  result.rotation = (prefix.rotation.conjugate() * transform.rotation).normalized();
  result.scale = transform.scale / prefix.scale;
  return result;
}

/// Keys of one property of one node, in the file's axes.
struct NodeKeys {
  int node = 0;
  ChannelPath path = ChannelPath::kTranslation;
  Interpolation interpolation = Interpolation::kLinear;
  std::vector<float> times, values;
};

class AnimationAdder {
 public:
  AnimationAdder(const Container& container, const Document& document, const Rig& rig, const ImportOptions& options)
      : document_(document), rig_(rig), file_(container, options), node_of_joint_(rig.skeleton.size(), -1) {
    for (std::size_t n = 0; n < rig.joint_of_node.size(); ++n) {
      if (rig.joint_of_node[n] >= 0) node_of_joint_[at(rig.joint_of_node[n])] = static_cast<int>(n);
    }
  }

  std::string add(const std::vector<Animation>& animations, bool keep_clips, bool binary, Notes& notes) {
    std::set<std::string> taken;
    if (keep_clips) {
      for (const AnimationEntry& entry : document_.animations) taken.insert(entry.name);
    }
    std::vector<std::string> added;
    for (const Animation& animation : animations) {
      const std::vector<NodeKeys> keys = keys_of(animation);
      if (keys.empty()) continue;
      std::string name = animation.name;
      for (int k = 2; !taken.insert(name).second; ++k) name = animation.name + "_" + std::to_string(k);
      added.push_back(animation_text(name, keys));
    }
    for (const int node : targets_) give_parts(node);
    if (!keep_clips && file_.count("animations") > 0) {
      if (added.empty())
        file_.text().erase(file_.text().root(), "animations");
      else
        file_.set_array("animations", added);
    } else {
      for (std::string& text : added) file_.add("animations", std::move(text));
    }
    file_.embed_files(notes);
    return file_.bytes(binary);
  }

 private:
  std::vector<NodeKeys> keys_of(const Animation& animation) {
    std::map<std::pair<int, ChannelPath>, const Channel*> last;  // the one that sample() obeys
    for (const Channel& channel : animation.channels) {
      if (!channel.times.empty()) last[{channel.joint, channel.path}] = &channel;
    }
    std::vector<NodeKeys> result;
    const bool made_root = node_of_joint_[0] < 0;
    bool root_moves = false;
    for (const auto& [place, channel] : last) root_moves = root_moves || (made_root && place.first == 0);
    for (const auto& [place, channel] : last) {
      const bool below_made = made_root && (place.first == 0 || rig_.skeleton.parents[at(place.first)] == 0);
      if (root_moves && below_made) continue;  // sampled together
      result.push_back(converted(*channel));
    }
    if (root_moves) add_below_root(animation, last, result);
    for (const NodeKeys& keys : result) targets_.insert(keys.node);
    return result;
  }

  NodeKeys converted(const Channel& channel) const {
    const FoldedTransform prefix = rig_.prefix[at(channel.joint)];
    const bool cubic = channel.interpolation == Interpolation::kCubicSpline;
    const bool one_key = cubic && channel.times.size() == 1;  // the format wants two keys for a spline
    const std::size_t width = channel.path == ChannelPath::kRotation ? 4 : 3;
    NodeKeys keys;
    keys.node = node_of_joint_[at(channel.joint)];
    keys.path = channel.path;
    keys.interpolation = one_key ? Interpolation::kStep : channel.interpolation;
    for (std::size_t i = 0; i * width < channel.values.size(); ++i) {
      const bool tangent = cubic && i % 3 != 1;
      if (one_key && tangent) continue;
      const double* v = channel.values.data() + i * width;
      if (channel.path == ChannelPath::kRotation) {
        const Eigen::Quaterniond q = prefix.rotation.conjugate() * Eigen::Quaterniond(v[3], v[0], v[1], v[2]);
        const double length = tangent ? 1.0 : q.norm();
        append(keys, {q.x() / length, q.y() / length, q.z() / length, q.w() / length});
      } else if (channel.path == ChannelPath::kScale) {
        append(keys, {v[0] / prefix.scale, v[1] / prefix.scale, v[2] / prefix.scale});
      } else {
        Eigen::Vector3d p(v[0], v[1], v[2]);
        if (!tangent) p -= prefix.translation;
        p = prefix.rotation.conjugate() * p / prefix.scale;
        append(keys, {p.x(), p.y(), p.z()});
      }
    }
    for (const double time : channel.times) keys.times.push_back(static_cast<float>(time));
    return keys;
  }

  /// Motion of the made root, together with that of each joint below it.
  void add_below_root(const Animation& animation, const std::map<std::pair<int, ChannelPath>, const Channel*>& last,
                      std::vector<NodeKeys>& result) const {
    std::set<double> times;
    for (const auto& [place, channel] : last) {
      if (place.first == 0 || rig_.skeleton.parents[at(place.first)] == 0)
        times.insert(channel->times.begin(), channel->times.end());
    }
    for (std::size_t j = 1; j < rig_.skeleton.size(); ++j) {
      if (rig_.skeleton.parents[j] != 0) continue;
      NodeKeys places{node_of_joint_[j], ChannelPath::kTranslation, Interpolation::kLinear, {}, {}};
      NodeKeys turns{node_of_joint_[j], ChannelPath::kRotation, Interpolation::kLinear, {}, {}};
      NodeKeys scales{node_of_joint_[j], ChannelPath::kScale, Interpolation::kLinear, {}, {}};
      const FoldedTransform root_rest{1.0, rig_.skeleton.rest[0].rotation, rig_.skeleton.rest[0].translation};
      const FoldedTransform prefix = root_rest * rig_.prefix[j];
      for (const double time : times) {
        const Pose pose = sample(animation, rig_.skeleton, time);
        const Transform local = unfolded(prefix, decompose(pose[0].matrix() * pose[j].matrix()));
        for (NodeKeys* keys : {&places, &turns, &scales}) keys->times.push_back(static_cast<float>(time));
        append(places, {local.translation.x(), local.translation.y(), local.translation.z()});
        append(turns, {local.rotation.x(), local.rotation.y(), local.rotation.z(), local.rotation.w()});
        append(scales, {local.scale.x(), local.scale.y(), local.scale.z()});
      }
      for (NodeKeys* keys : {&places, &turns, &scales}) result.push_back(std::move(*keys));
    }
  }

  static void append(NodeKeys& keys, std::initializer_list<double> values) {
    for (const double value : values) keys.values.push_back(static_cast<float>(value) + 0.0f);
  }

  std::string animation_text(const std::string& name, const std::vector<NodeKeys>& all) {
    std::vector<float> numbers;
    struct Part {
      std::size_t first, count;
    };
    std::map<std::vector<float>, Part> known_times;
    std::vector<std::pair<Part, Part>> parts;  // times, values
    const auto store = [&](const std::vector<float>& values) {
      const Part part{numbers.size(), values.size()};
      numbers.insert(numbers.end(), values.begin(), values.end());
      return part;
    };
    for (const NodeKeys& keys : all) {
      check_keys(keys, name);
      const auto known = known_times.find(keys.times);
      const Part times = known != known_times.end() ? known->second : store(keys.times);
      known_times.emplace(keys.times, times);
      parts.emplace_back(times, store(keys.values));
    }
    const int view = file_.add_numbers(numbers);
    std::map<std::size_t, int> time_accessors;
    Json channels = Json::array(), samplers = Json::array();
    for (std::size_t i = 0; i < all.size(); ++i) {
      const auto& [times, values] = parts[i];
      auto input = time_accessors.find(times.first);
      if (input == time_accessors.end())
        input =
            time_accessors.emplace(times.first, file_.add_numbers_accessor(view, numbers, times.first, times.count, 1))
                .first;
      const std::size_t width = all[i].path == ChannelPath::kRotation ? 4 : 3;
      channels.push_back(
          {{"sampler", samplers.size()}, {"target", {{"node", all[i].node}, {"path", name_of(all[i].path)}}}});
      samplers.push_back(
          {{"input", input->second},
           {"interpolation", name_of(all[i].interpolation)},
           {"output", file_.add_numbers_accessor(view, numbers, values.first, values.count / width, width)}});
    }
    Json entry = {{"channels", std::move(channels)}, {"samplers", std::move(samplers)}};
    if (!name.empty()) entry["name"] = name;
    return entry.dump(-1, ' ', false, Json::error_handler_t::replace);
  }

  void check_keys(const NodeKeys& keys, const std::string& name) const {
    const auto is_finite = [](float x) { return std::isfinite(x); };
    bool sound = std::all_of(keys.values.begin(), keys.values.end(), is_finite);
    for (std::size_t k = 0; k < keys.times.size(); ++k)
      sound = sound && std::isfinite(keys.times[k]) && (k == 0 || keys.times[k] > keys.times[k - 1]);
    if (!sound) {
      throw InputError(document_.file, "clip '" + name + "'",
                       "a number exceeds single precision, or two keys are at one time there");
    }
  }

  /// A node with a matrix gets translation, rotation and scale instead.
  void give_parts(int node) {
    const Json& json = file_.json()["nodes"][at(node)];
    if (!json.contains("matrix")) return;
    const Node& entry = document_.nodes[at(node)];
    if (entry.shear > 1e-4) {
      throw NotSupportedError(document_.file, "/nodes/" + std::to_string(node),
                              "an animation of a node with a sheared matrix");
    }
    const Transform& local = entry.local;
    const Eigen::Vector3d &t = local.translation, &s = local.scale;
    const Eigen::Quaterniond& r = local.rotation;
    const Json parts = {{"translation", {t.x(), t.y(), t.z()}},
                        {"rotation", {r.x(), r.y(), r.z(), r.w()}},
                        {"scale", {s.x(), s.y(), s.z()}}};
    const std::string text = parts.dump();
    file_.text().replace_member(file_.original("nodes", at(node)), "matrix", text.substr(1, text.size() - 2));
  }

  const Document& document_;
  const Rig& rig_;
  GraftFile file_;
  std::vector<int> node_of_joint_;
  std::set<int> targets_;
};

void check_animations(const std::string& file, const Rig& rig, const std::vector<Animation>& animations) {
  Asset bare;
  bare.skeleton = rig.skeleton;
  bare.animations = animations;
  const std::vector<std::string> findings = validate(bare, 1, false);
  if (!findings.empty()) throw InputError(file, "", "the animations for it are not sound: " + findings.front());
}

}  // namespace

}  // namespace gltf_import

std::vector<ImportNote> add_animations(const std::filesystem::path& original, const std::vector<Animation>& animations,
                                       const std::filesystem::path& out, const AddAnimationOptions& options) {
  const bool binary = is_binary_extension(out);
  try {
    ImportOptions import_options;
    import_options.require_rig = false;
    gltf_import::Notes repairs, notes;  // read_gltf() tells the first
    gltf_import::Container container;
    gltf_import::read_container(original, import_options, container, true);
    const gltf_import::Document document = gltf_import::parse_document(container, import_options, repairs);
    gltf_import::Rig rig =
        gltf_import::build_rig(document, gltf_import::moving_nodes(document, repairs), import_options, repairs);
    if (rig.skeleton.size() == 0) throw InputError(original.string(), "", "there is no skeleton to animate");
    gltf_import::bind_skins(document, rig, repairs);
    gltf_import::check_animations(original.string(), rig, animations);
    gltf_import::AnimationAdder adder(container, document, rig, import_options);
    write_file_atomically(out, adder.add(animations, options.keep_clips, binary, notes));
    return notes.take();
  } catch (const std::bad_alloc&) {
    throw InputError(original.string(), "", "copying it needs more memory than there is");
  } catch (const std::length_error&) {
    throw InputError(original.string(), "", "copying it needs more memory than there is");
  }
}

}  // namespace anigen::io
