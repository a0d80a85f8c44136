#include "anigen/io/rigs/bvh.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <set>
#include <string_view>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/numeric.h"
#include "anigen/core/text.h"
#include "anigen/io/obj.h"

namespace anigen::io {

namespace {

constexpr std::uintmax_t kMostBytes = std::uintmax_t{1} << 30;
constexpr std::size_t kMostJoints = 10'000;
constexpr double kMostMotionValues = 1e8;
constexpr double kLargest = 1e9;  ///< of a coordinate or an angle: beyond, a file is damaged
constexpr std::size_t kShown = 40;

/// The file's Y up to our Z up; a rotation, so axes of rotations turn with it.
Eigen::Vector3d to_z_up(const Eigen::Vector3d& v) { return {v.x(), -v.z(), v.y()}; }

struct BvhChannel {
  bool turns = false;
  int axis = 0;  ///< 0, 1, 2: the file's X, Y, Z
};

class BvhParser : TextLines {
 public:
  BvhParser(const std::string& text, const std::string& file) : TextLines(text, file) {}

  BvhMotion parse() {
    expect("hierarchy");
    hierarchy();
    motion();
    return std::move(result_);
  }

 private:
  // --- Words; a word may be on any line, but frames are lines -----------------------------------------------------

  /// Empty at the end of the file.
  std::string_view try_word() {
    for (;;) {
      const std::string_view token = take_token(left_);
      if (!token.empty()) return token;
      if (!next_line()) return {};
    }
  }

  std::string word(const std::string& what) {
    const std::string_view token = try_word();
    if (token.empty()) fail("the file ends where " + what + " should be");
    return std::string(token);
  }

  void expect(const std::string& keyword) {
    const std::string found = word("\"" + keyword + "\"");
    if (lower_case(found) != keyword) fail("\"" + found.substr(0, kShown) + "\" where \"" + keyword + "\" should be");
  }

  double number(std::string_view token) const {
    const double value = TextLines::number(token);
    if (std::abs(value) > kLargest) fail("\"" + std::string(token.substr(0, kShown)) + "\" is too large to be meant");
    return value;
  }

  std::size_t count(const std::string& what, double most) {
    const double value = number(word(what));
    if (value < 0 || value > most || value != std::floor(value))
      fail(what + " must be a whole number up to " + std::to_string(static_cast<std::int64_t>(most)));
    return static_cast<std::size_t>(value);
  }

  // --- The skeleton: braces on a stack of our own, so that no nesting is too deep ---------------------------------

  void hierarchy() {
    expect("root");
    open_joint(-1, word("the root's name"));
    std::vector<int> open = {0};
    while (!open.empty()) {
      const std::string token = word("\"}\" of " + result_.skeleton.names[at(open.back())]);
      const std::string keyword = lower_case(token);
      if (keyword == "}") {
        open.pop_back();
      } else if (keyword == "joint") {
        open.push_back(open_joint(open.back(), word("a joint's name")));
      } else if (keyword == "end") {
        expect("site");
        end_site(open.back());
      } else if (keyword == "channels") {
        channels_of(open.back());
      } else {
        fail("\"" + token.substr(0, kShown) + "\" is none of CHANNELS, JOINT, End Site, }");
      }
    }
    const std::string token = word("\"MOTION\"");
    if (lower_case(token) == "root")
      throw NotSupportedError(file_, "line " + std::to_string(line_), "several skeletons");
    if (lower_case(token) != "motion") fail("\"" + token.substr(0, kShown) + "\" where \"MOTION\" should be");
  }

  int open_joint(int parent, const std::string& name) {
    expect("{");
    expect("offset");
    return add_joint(parent, name);
  }

  void end_site(int parent) {
    expect("{");
    expect("offset");
    std::string name = result_.skeleton.names[at(parent)] + "_end";
    while (names_.count(name) > 0) name += "_";
    add_joint(parent, name);
    expect("}");
  }

  int add_joint(int parent, const std::string& name) {
    if (!names_.insert(name).second)
      fail("there is a joint \"" + name.substr(0, 80) + "\" already: a skeleton has each once, and no cycles");
    if (result_.skeleton.size() == kMostJoints) fail("more than " + std::to_string(kMostJoints) + " joints");
    Eigen::Vector3d offset;
    for (double& x : offset) x = number(word("an offset"));
    Skeleton& skeleton = result_.skeleton;
    Transform local;
    local.translation = to_z_up(offset);
    Eigen::Matrix4d world = local.matrix();
    if (parent >= 0) world = skeleton.bind[at(parent)] * world;
    skeleton.names.push_back(name);
    skeleton.parents.push_back(parent);
    skeleton.rest.push_back(local);
    skeleton.bind.push_back(world);
    offsets_.push_back(offset);
    channels_.emplace_back();
    return static_cast<int>(skeleton.size()) - 1;
  }

  void channels_of(int joint) {
    std::vector<BvhChannel>& channels = channels_[at(joint)];
    if (!channels.empty()) fail("a second CHANNELS of " + result_.skeleton.names[at(joint)]);
    const std::size_t wanted = count("the number of channels", 6);
    std::set<std::string> known;
    while (channels.size() < wanted) {
      const std::string token = word("a channel");
      const std::string name = lower_case(token);
      const std::string kind = name.substr(std::min<std::size_t>(1, name.size()));
      if (name.find_first_of("xyz") != 0 || (kind != "position" && kind != "rotation"))
        fail("\"" + token.substr(0, kShown) + "\" is not a channel; there are Xposition … Zrotation");
      if (!known.insert(name).second) fail("the channel " + token + " is given twice");
      channels.push_back({kind == "rotation", name[0] - 'x'});
    }
    channel_count_ += wanted;
  }

  // --- The motion -------------------------------------------------------------------------------------------------

  void motion() {
    expect("frames:");
    result_.frames = count("the number of frames", kLargest);
    if (result_.frames == 0) fail("there is no frame");
    expect("frame");
    expect("time:");
    result_.frame_time = number(word("the time of a frame"));
    if (!(result_.frame_time > 0.0)) fail("the time of a frame must be positive, in seconds");
    if (!take_token(left_).empty()) fail("something stands behind the time of a frame");
    if (channel_count_ == 0) fail("no joint has a channel: nothing moves");
    if (static_cast<double>(result_.frames) * static_cast<double>(channel_count_) > kMostMotionValues)
      fail(std::to_string(result_.frames) + " frames of " + std::to_string(channel_count_) +
           " channels are more than this program takes");
    start_keys();
    std::size_t read = 0;
    std::vector<double> values;
    while (next_line()) {
      values.clear();
      std::string_view token = take_token(left_);
      if (token.empty()) continue;
      if (read == result_.frames) {
        log::warn("{}: line {}: there are more frames than the {} announced; they are left out", file_, line_, read);
        break;
      }
      std::size_t found = 0;
      for (; !token.empty(); token = take_token(left_)) {
        if (++found <= channel_count_) values.push_back(number(token));
      }
      if (found != channel_count_)
        fail("the frame has " + std::to_string(found) + " values for " + std::to_string(channel_count_) + " channels");
      add_keys(static_cast<double>(read++) * result_.frame_time, values);
    }
    if (read < result_.frames)
      fail("the file ends after " + std::to_string(read) + " of " + std::to_string(result_.frames) + " frames");
  }

  /// One track of rotations and one of translations for the joints whose channels say something of them.
  void start_keys() {
    for (std::size_t j = 0; j < channels_.size(); ++j) {
      for (const bool turns : {false, true}) {
        for (const BvhChannel& channel : channels_[j]) {
          if (channel.turns != turns) continue;
          Channel track;
          track.joint = static_cast<int>(j);
          track.path = turns ? ChannelPath::kRotation : ChannelPath::kTranslation;
          result_.animation.channels.push_back(std::move(track));
          break;
        }
      }
    }
  }

  void add_keys(double time, const std::vector<double>& values) {
    std::size_t track = 0, value = 0;
    for (std::size_t j = 0; j < channels_.size(); ++j) {
      Eigen::Vector3d position = offsets_[j];
      Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
      bool moves = false, turns = false;
      for (const BvhChannel& channel : channels_[j]) {
        const double x = values[value++];
        if (channel.turns) {
          const Eigen::Vector3d axis = to_z_up(Eigen::Vector3d::Unit(channel.axis));
          rotation = rotation * Eigen::AngleAxisd(std::remainder(x, 360.0) * kPi / 180.0, axis);
          turns = true;
        } else {
          position[channel.axis] = x;
          moves = true;
        }
      }
      if (moves) {
        const Eigen::Vector3d place = to_z_up(position);
        add_key(track++, time, {place.x(), place.y(), place.z()});
      }
      rotation.normalize();
      if (turns) add_key(track++, time, {rotation.x(), rotation.y(), rotation.z(), rotation.w()});
    }
  }

  void add_key(std::size_t track, double time, std::initializer_list<double> values) {
    Channel& channel = result_.animation.channels[track];
    channel.times.push_back(time);
    channel.values.insert(channel.values.end(), values);
  }

  std::set<std::string> names_;
  std::vector<Eigen::Vector3d> offsets_;  ///< as in the file
  std::vector<std::vector<BvhChannel>> channels_;
  std::size_t channel_count_ = 0;
  BvhMotion result_;
};

}  // namespace

BvhMotion parse_bvh(const std::string& text, const std::string& file) {
  BvhMotion motion = BvhParser(text, file).parse();
  motion.animation.name = std::filesystem::path(file).stem().string();
  return motion;
}

BvhMotion read_bvh(const std::filesystem::path& file) { return parse_bvh(read_file(file, kMostBytes), file.string()); }

}  // namespace anigen::io
