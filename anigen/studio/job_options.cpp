#include "anigen/studio/job_options.h"

#include <algorithm>
#include <filesystem>

#include "anigen/core/error.h"
#include "anigen/core/text.h"
#include "anigen/io/rigs/rig_listing.h"

namespace anigen::studio {

namespace {

const std::vector<std::string>& image_extensions() {
  static const std::vector<std::string> words{".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tif", ".tiff"};
  return words;
}

const std::vector<std::string>& mesh_extensions() {
  static const std::vector<std::string> words{".glb", ".gltf", ".fbx", ".dae", ".obj", ".ply", ".stl", ".3mf"};
  return words;
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
  rig.keep_skeleton = reader.boolean("keep_skeleton", true);
  rig.joints = static_cast<std::size_t>(reader.integer("joints", 0, 0, 1000));
  rig.symmetric = reader.boolean("symmetric", false);
  rig.influences = static_cast<std::size_t>(reader.integer("influences", 4, 1, 64));
  rig.names = reader.choice("names", "", {"", "chain", "vrm", "mixamo", "unreal", "unity"});
}

void read_generate_options(ConfigReader& reader, engine::GenerateOptions& generate) {
  generate.seed = static_cast<std::uint64_t>(reader.integer("seed", 42, 0));
  if (reader.has("ss_steps")) generate.structure_steps = static_cast<int>(reader.integer("ss_steps", 1, 1, 1000));
  if (reader.has("slat_steps")) generate.latent_steps = static_cast<int>(reader.integer("slat_steps", 1, 1, 1000));
  generate.joints = static_cast<int>(reader.integer("joints", 0, 0, 1000));
}

}  // namespace

const std::vector<std::string>& rig_methods() {
  static const std::vector<std::string> words{"auto", "curve", "pinocchio", "nearest", "geovoxel", "heat"};
  return words;
}

bool keeps_joints(const std::string& method) { return method == "nearest" || method == "geovoxel" || method == "heat"; }

JobOptions parse_job_options(const Json& json, const std::string& kind) {
  JobOptions options;
  ConfigReader reader(json, "options");
  if (kind == "image") {
    read_generate_options(reader, options.generate);
  } else {
    read_rig_options(reader, options.rig);
  }
  options.all_motions = !reader.has("motions");
  options.motions = reader.texts("motions", {});
  const std::vector<std::string> known = engine::motion_words();
  for (const std::string& word : options.motions) {
    // Files are for the program: a request must not read this machine's disk.
    if (std::find(known.begin(), known.end(), word) == known.end())
      throw reader.error("motions", "\"" + word + "\" is no built-in motion; " + suggestion(word, known));
  }
  reader.finish();
  return options;
}

std::string kind_of_upload(const std::string& name) {
  const std::filesystem::path file = name;
  if (io::has_extension(file, image_extensions())) return "image";
  if (io::has_extension(file, mesh_extensions())) return "mesh";
  throw InputError(
      name, "",
      "is neither an image (" + joined(image_extensions()) + ") nor a mesh (" + joined(mesh_extensions()) + ")");
}

}  // namespace anigen::studio
