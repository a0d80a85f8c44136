#include "anigen/studio/job_options.h"

#include <algorithm>
#include <cstddef>

#include "anigen/core/error.h"
#include "anigen/core/text.h"
#include "anigen/io/rigs/rig_listing.h"

namespace anigen::studio {

namespace {

constexpr double kClipRate = 24.0;               // key frames per second of the clips that come along
constexpr std::size_t kSurfaceSamples = 20'000;  // of evaluations, whose reader waits

struct FormatWords {
  const char* what;
  std::vector<std::string> extensions;
};

const FormatWords& words_of(UploadFormat format) {
  static const FormatWords image{"an image", {".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tif", ".tiff"}},
      mask{"a mask", {".png"}}, mesh{"a mesh", {".glb", ".gltf", ".fbx", ".dae", ".obj", ".ply", ".stl", ".3mf"}},
      rig{"a rigged asset", {".glb", ".gltf", ".fbx", ".dae"}},
      motion{"a motion", {".bvh", ".fbx", ".dae", ".glb", ".gltf"}};
  switch (format) {
    case UploadFormat::kImage:
      return image;
    case UploadFormat::kMask:
      return mask;
    case UploadFormat::kMesh:
      return mesh;
    case UploadFormat::kRig:
      return rig;
    case UploadFormat::kMotion:
      return motion;
  }
  return mesh;
}

void read_rig_options(ConfigReader& reader, engine::RigOptions& rig) {
  rig.method = reader.choice("method", rig.method, rig_methods());
  const std::vector<std::string> bindings{"", "nearest", "geovoxel", "heat"};
  rig.skin = reader.choice("skin", "", bindings);
  rig.templates = reader.texts("templates", {});
  const std::vector<std::string> known = engine::template_words();
  for (const std::string& word : rig.templates) {
    if (std::find(known.begin(), known.end(), word) == known.end())
      throw reader.error("templates", "\"" + word + "\" is no species; " + suggestion(word, known));
  }
  if (!rig.templates.empty() && rig.method != "auto" && rig.method != "pinocchio")
    throw reader.error("templates", "are for the methods auto and pinocchio; this is " + rig.method);
  rig.keep_skeleton = reader.boolean("keep_skeleton", true);
  rig.joints = static_cast<std::size_t>(reader.integer("joints", 0, 0, 1000));
  rig.symmetric = reader.boolean("symmetric", false);
  rig.influences = static_cast<std::size_t>(reader.integer("influences", 4, 1, 64));
  std::vector<std::string> names = name_presets();
  names.emplace_back();
  rig.names = reader.choice("names", "", names);
  rig.bone_axes = reader.choice("bone_axes", "", {"", "world", "along"});
}

void read_generate_options(ConfigReader& reader, engine::GenerateOptions& generate, std::string& voxels_of) {
  generate.seed = static_cast<std::uint64_t>(reader.integer("seed", 42, 0));
  if (reader.has("ss_steps")) generate.structure_steps = static_cast<int>(reader.integer("ss_steps", 1, 1, 1000));
  if (reader.has("slat_steps")) generate.latent_steps = static_cast<int>(reader.integer("slat_steps", 1, 1, 1000));
  generate.joints = static_cast<int>(reader.integer("joints", 0, 0, 1000));
  generate.stop_at = reader.choice("stop_at", "", {"", "voxels"});
  voxels_of = reader.text("voxels_of", "");
  if (!voxels_of.empty() && !generate.stop_at.empty())
    throw reader.error("stop_at", "ends where voxels_of begins; leave one out");
}

void read_animate_options(ConfigReader& reader, engine::AnimateOptions& animate) {
  animate.fps = reader.number("fps", kClipRate, 1.0, 240.0);
  animate.travel = reader.boolean("travel", false);
}

void read_evaluate_options(ConfigReader& reader, engine::EvaluateOptions& evaluate) {
  evaluate.protocol = reader.text("protocol", "");
  evaluate.groups = reader.texts("groups", {});
  evaluate.registration = reader.boolean("registration", true);
  if (evaluate.groups.empty() && evaluate.protocol.empty())
    evaluate.groups = {"skeleton", "transport", "skin", "surface"};
  evaluate.surface_samples = kSurfaceSamples;
}

void read_motions(ConfigReader& reader, JobOptions& options) {
  options.all_motions = !reader.has("motions");
  options.motions = reader.texts("motions", {});
  const std::vector<std::string> known = engine::motion_words();
  for (const std::string& word : options.motions) {
    // Files are for the program: a request must not read this machine's disk.
    if (std::find(known.begin(), known.end(), word) == known.end())
      throw reader.error("motions", "\"" + word + "\" is no built-in motion; " + suggestion(word, known));
  }
}

}  // namespace

const std::vector<std::string>& rig_methods() {
  static const std::vector<std::string> words{"auto", "curve", "pinocchio", "nearest", "geovoxel", "heat"};
  return words;
}

bool keeps_joints(const std::string& method) { return method == "nearest" || method == "geovoxel" || method == "heat"; }

const std::vector<std::string>& name_presets() {
  static const std::vector<std::string> words{"chain", "vrm", "mixamo", "unreal", "unity"};
  return words;
}

JobOptions parse_job_options(const Json& json, const std::string& kind) {
  JobOptions options;
  options.animate.fps = kClipRate;
  ConfigReader reader(json, "options");
  if (kind == "generation") read_generate_options(reader, options.generate, options.voxels_of);
  if (kind == "rig") read_rig_options(reader, options.rig);
  if (kind == "animation") read_animate_options(reader, options.animate);
  if (kind == "evaluation") {
    read_evaluate_options(reader, options.evaluate);
  } else {
    read_motions(reader, options);
  }
  reader.finish();
  return options;
}

void require_format(const std::string& name, UploadFormat format) {
  const FormatWords& words = words_of(format);
  if (io::has_extension(name, words.extensions)) return;
  throw InputError(name, "", std::string("is not ") + words.what + " (" + joined(words.extensions) + ")");
}

}  // namespace anigen::studio
