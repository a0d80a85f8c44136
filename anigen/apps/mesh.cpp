#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "anigen/apps/common/command_line.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/process.h"
#include "anigen/core/text.h"
#include "anigen/eval/describe.h"
#include "anigen/eval/inspect.h"
#include "anigen/geometry/simplify.h"
#include "anigen/io/io.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/io/rigs/samples.h"
#include "anigen/mesh_health/mesh_health.h"

namespace {

using namespace anigen;
namespace fs = std::filesystem;

struct MeshArguments {
  std::vector<std::string> files;  ///< of check
  std::string input, output;
  double asset_timeout = 600.0;
  std::uint64_t memory_mb = 0;
  mesh_health::CheckOptions check;
  bool no_crossings = false;
  mesh_health::RepairOptions repair;
  mesh_health::WrapOptions wrap;
  mesh_health::RemeshOptions remesh;
  double edge_length = 0.0;  ///< share of the diagonal
  std::size_t faces = 0;
  double reduction = 0.0;

  mesh_health::WorkLimits limits() const { return {asset_timeout, memory_mb << 20}; }
};

/// A mesh with all that can be read of its file. @throws InputError when it has no faces
io::ImportedAsset read_surface(const std::string& file) {
  const eval::FileKind kind = eval::file_kind(file);
  if (!eval::is_geometry(kind)) throw InputError(file, "", "holds no mesh");
  io::ImportedAsset read = eval::read_geometry(file, kind).imported;
  if (read.asset.mesh.faces.empty()) throw InputError(file, "", "holds no faces");
  return read;
}

/// Runs work on the mesh of a file under the limits; errors name the file.
mesh_health::MeshResult run_on(const std::string& file, const std::string& label,
                               const std::function<mesh_health::MeshResult(const mesh_health::StepReport&)>& work,
                               const MeshArguments& arguments) {
  try {
    return mesh_health::run_limited(label, work, arguments.limits());
  } catch (const InputError& error) {
    throw InputError(error.file().empty() ? file : error.file(), error.place(), error.problem());
  } catch (const Interrupted&) {
    throw;
  } catch (const Error& error) {
    throw Error(file + ": " + error.what());
  }
}

// --- check ---

struct CheckedFile {
  std::string file;
  Json figures;         ///< null when it failed
  std::string failure;  ///< empty: it was checked
  bool unreadable = false;
};

CheckedFile check_one(const std::string& file, const MeshArguments& arguments) {
  CheckedFile checked{file, {}, "", false};
  try {
    const Mesh mesh = read_surface(file).asset.mesh;
    const auto work = [&](const mesh_health::StepReport&) {
      return mesh_health::MeshResult{{}, {}, to_json(mesh_health::check_mesh(mesh, arguments.check))};
    };
    checked.figures = run_on(file, "checking", work, arguments).figures;
  } catch (const InputError&) {
    checked.unreadable = true;
    checked.failure = failure_of_item();
  } catch (...) {
    checked.failure = failure_of_item();
  }
  return checked;
}

Json to_json(const CheckedFile& checked) {
  Json json = {{"file", checked.file}};
  if (!checked.failure.empty()) {
    json["failure"] = checked.failure;
  } else {
    json.update(checked.figures);
  }
  return json;
}

void check_files(MeshArguments& arguments, const CommonOptions& common) {
  arguments.check.self_intersections = !arguments.no_crossings;
  std::vector<CheckedFile> results;
  for (const std::string& file : arguments.files) {
    throw_if_interrupted();
    results.push_back(check_one(file, arguments));
  }
  const bool several = results.size() > 1;
  Json list = Json::array();
  std::string text;
  std::size_t failed = 0, unreadable = 0, unsound = 0;
  for (const CheckedFile& checked : results) {
    list.push_back(to_json(checked));
    failed += !checked.failure.empty();
    unreadable += checked.unreadable;
    unsound += checked.failure.empty() && !checked.figures.at("findings").empty();
    const std::string verdict =
        checked.failure.empty() ? checked.figures.at("verdict").get<std::string>() : checked.failure;
    if (several) text += checked.file + ": " + verdict + "\n";
  }
  if (!several && failed == 0) text = eval::to_text(list[0]);
  // Names of files need not be UTF-8, which JSON demands.
  const auto dumped = [](const Json& json) { return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n"; };
  std::fputs((common.json ? dumped(several ? list : list[0]) : text).c_str(), stdout);
  const std::string count = std::to_string(results.size());
  if (!several && unreadable > 0) throw InputError("", "", results[0].failure);
  if (!several && failed > 0) throw Error(results[0].failure);
  if (unreadable > 0 && !(common.keep_going && unreadable < results.size()))
    throw InputError("", "",
                     std::to_string(unreadable) + " of " + count + " files cannot be read; --keep-going allows some");
  if (unsound > 0)
    throw Error(several ? std::to_string(unsound) + " of " + count + " meshes have findings"
                        : results[0].file + ": " + results[0].figures.at("verdict").get<std::string>());
  require_inputs(failed, results.size(), "meshes could not be checked", common);
}

// --- Commands that write ---

enum class Format { kGltf, kObj, kPly, kStl };

Format format_of(const std::string& output) {
  const std::string extension = lower_case(fs::path(output).extension().string());
  if (extension == ".glb" || extension == ".gltf") return Format::kGltf;
  if (extension == ".obj") return Format::kObj;
  if (extension == ".ply") return Format::kPly;
  if (extension == ".stl") return Format::kStl;
  throw InputError(output, "--output", "expected .glb, .gltf, .obj, .ply or .stl");
}

/// Parts of an asset that the format has no place for.
std::vector<std::string> not_in_format(const Asset& asset, Format format) {
  std::vector<std::string> lost;
  if (format == Format::kGltf) return lost;
  if (asset.skeleton.size() > 0) lost.emplace_back("the rig");
  if (!asset.animations.empty()) lost.emplace_back("animations");
  if (!asset.materials.empty()) lost.emplace_back("materials");
  if (format != Format::kStl) return lost;
  if (!asset.mesh.uvs.empty()) lost.emplace_back("texture coordinates");
  if (!asset.mesh.colors.empty()) lost.emplace_back("colours of vertices");
  return lost;
}

/// Parts of a file that an asset has no place for.
std::vector<std::string> not_read(const io::ImportedAsset& read) {
  static const std::set<std::string> kLosses = {"morph_targets",     "skipped_lines",       "missing_image",
                                                "unsupported_image", "unsupported_texture", "dropped_channels",
                                                "empty_animation"};
  std::vector<std::string> lost;
  for (const io::ImportNote& note : read.notes) {
    if (kLosses.count(note.code) > 0) lost.push_back(note.message);
  }
  if (!read.node_clips.empty()) lost.emplace_back("animations of nodes");
  return lost;
}

/// @param influences joints per vertex that the file had at most
void save(const std::string& output, Asset asset, Format format, std::size_t influences) {
  switch (format) {
    case Format::kGltf: {
      io::ExportOptions options;
      options.require_rig = false;
      options.influences = std::max(options.influences, influences);
      io::write_gltf(output, asset, options);
      return;
    }
    case Format::kObj:  // Y up, as OBJ files are read
      for (auto* vectors : {&asset.mesh.vertices, &asset.mesh.normals})
        for (Eigen::Vector3f& v : *vectors) v = Eigen::Vector3f(v.x(), v.z(), -v.y());
      io::write_obj(output, asset.mesh);
      return;
    case Format::kPly:
      io::write_ply(output, asset.mesh);
      return;
    case Format::kStl:
      io::write_stl(output, asset.mesh);
      return;
  }
}

using Work = std::function<mesh_health::MeshResult(const Mesh&, const mesh_health::StepReport&)>;
/// Puts a result in the place of the asset's mesh.
using Carry = std::function<mesh_health::CarriedAsset(const Asset&, mesh_health::MeshResult&)>;

mesh_health::CarriedAsset carry_by_place(const Asset& asset, mesh_health::MeshResult& result) {
  return mesh_health::carry_to_new_surface(asset, std::move(result.mesh));
}

/// Reads, works on the mesh, carries over what can be, writes, and tells.
void make_mesh(const MeshArguments& arguments, const std::string& label, const Work& work, const Carry& carry,
               const CommonOptions& common) {
  const auto started = std::chrono::steady_clock::now();
  const Format format = format_of(arguments.output);
  refuse_to_overwrite({arguments.output}, [&] {
    const auto sample = io::sample_of(arguments.input);
    return io::files_read_with(sample ? sample->first : fs::path(arguments.input));
  });
  const io::ImportedAsset read = read_surface(arguments.input);
  const Asset& asset = read.asset;
  mesh_health::MeshResult result = run_on(
      arguments.input, label, [&](const auto& report) { return work(asset.mesh, report); }, arguments);
  throw_if_interrupted();
  mesh_health::CarriedAsset carried = carry(asset, result);
  if (carried.asset.skin.rows() == 0 && carried.asset.skeleton.size() > 0) {
    carried.asset.skeleton = {};
    carried.asset.animations.clear();
    carried.lost.emplace_back("a skeleton that moves nothing");
  }
  for (const std::vector<std::string>& parts : {not_read(read), not_in_format(carried.asset, format)})
    carried.lost.insert(carried.lost.end(), parts.begin(), parts.end());
  if (!carried.lost.empty()) log::warn("{}: not kept: {}", arguments.output, joined(carried.lost));
  Json told = {{"file", arguments.input},
               {"output", arguments.output},
               {"faces_before", asset.mesh.faces.size()},
               {"vertices_before", asset.mesh.vertices.size()}};
  told.update(result.figures);
  told["joints"] = carried.asset.skeleton.size();
  told["not_kept"] = carried.lost;
  throw_if_interrupted();
  save(arguments.output, std::move(carried.asset), format, asset.skin.largest_row());
  told["seconds"] = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
  const std::string dumped = told.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
  std::fputs((common.json ? dumped : eval::to_text(told)).c_str(), stdout);
}

mesh_health::MeshResult repair_work(const Mesh& mesh, const mesh_health::RepairOptions& options) {
  mesh_health::Repaired repaired = mesh_health::repair(mesh, options);
  Json figures = to_json(repaired);
  return {std::move(repaired.mesh), std::move(repaired.place), std::move(figures)};
}

mesh_health::MeshResult wrap_work(const Mesh& mesh, const mesh_health::WrapOptions& options,
                                  const mesh_health::StepReport& report) {
  Mesh made = mesh_health::wrap(mesh, options, report);
  Json figures = {{"vertices", made.vertices.size()}, {"faces", made.faces.size()}};
  return {std::move(made), {}, std::move(figures)};
}

mesh_health::MeshResult remesh_work(const Mesh& mesh, const MeshArguments& arguments,
                                    const mesh_health::StepReport& report) {
  mesh_health::RemeshOptions options = arguments.remesh;
  options.faces = arguments.faces;
  const double diagonal = bounding_box(mesh.vertices).diagonal();
  options.edge_length = arguments.edge_length * diagonal;
  mesh_health::Remeshed made = mesh_health::remesh(mesh, options, report);
  Json figures = to_json(made);
  figures["edge_length_share"] = diagonal > 0 ? made.edge_length / diagonal : 0.0;
  return {std::move(made.mesh), {}, std::move(figures)};
}

mesh_health::MeshResult simplify_work(const Mesh& mesh, const MeshArguments& arguments) {
  const mesh_health::WeldedMesh welded = mesh_health::weld(mesh);
  if (welded.faces.empty()) throw InputError("", "mesh.faces", "no face has three places");
  const std::size_t target =
      arguments.faces > 0 ? arguments.faces : geometry::reduced_face_count(welded.faces.size(), arguments.reduction);
  geometry::Simplified made = geometry::simplify(welded.places, welded.faces, target);
  if (made.mesh.faces.empty()) throw Error("nothing is left of the mesh");
  Json figures = {{"vertices", made.mesh.vertices.size()},
                  {"faces", made.mesh.faces.size()},
                  {"reached", made.reached},
                  {"locked_vertices", made.locked}};
  return {std::move(made.mesh), {}, std::move(figures)};
}

void add_limits(CLI::App& command, MeshArguments& arguments) {
  add_option(command, "--asset-timeout", arguments.asset_timeout)->check(number(0, 1e6));
  add_option(command, "--memory-mb", arguments.memory_mb)->check(whole_number(0, std::uint64_t{1} << 40));
}

CLI::App& writing_command(Program& program, const std::string& name, const std::string& purpose,
                          MeshArguments& arguments) {
  CLI::App& command = program.command(name, purpose);
  add_option(command, "MESH", arguments.input)->required();
  add_option(command, "--output", arguments.output, ": .glb, .gltf, .obj, .ply or .stl")->required();
  add_limits(command, arguments);
  return command;
}

}  // namespace

int main(int argc, char** argv) {
  Program program(
      "anigen-mesh",
      "Says whether surfaces are sound, and makes them so. Skin weights, skeleton, animations and colours come along.\n"
      "check exits with 0 for sound meshes, 1 for findings, 2 for what cannot be read. GPL-3 as a binary (CGAL).",
      "  anigen-mesh check fox.glb\n"
      "  anigen-mesh check models/*.glb --json --keep-going\n"
      "  anigen-mesh repair fox.glb -o sound.glb --fill-holes 32\n"
      "  anigen-mesh wrap fox.glb -o closed.glb --alpha 0.01\n"
      "  anigen-mesh remesh fox.glb -o even.glb --faces 20000\n"
      "  anigen-mesh simplify fox.glb -o small.glb --faces 2000");
  MeshArguments arguments;
  program.app.require_subcommand(1);
  CLI::App& check = program.command("check", "Counts what is wrong with surfaces, and measures them");
  add_option(check, "files", arguments.files)->required();
  add_option(check, "--solid", arguments.check.solid);
  add_option(check, "--no-crossings", arguments.no_crossings);
  add_limits(check, arguments);
  CLI::App& repair = writing_command(
      program, "repair", "Mends in place: an oriented manifold without faces of no area; textures stay", arguments);
  add_option(repair, "--merge-distance", arguments.repair.merge_distance)->check(number(0, 0.1));
  add_option(repair, "--fill-holes", arguments.repair.fill_edges)->check(whole_number(0, 1'000'000));
  CLI::App& wrap = writing_command(program, "wrap", "A closed manifold around whatever there is", arguments);
  add_option(wrap, "--alpha", arguments.wrap.alpha)->check(number(1e-6, 1));
  add_option(wrap, "--offset", arguments.wrap.offset)->check(number(1e-6, 1))->default_str("");
  CLI::App& remesh = writing_command(program, "remesh", "Triangles of equal size on the same surface", arguments);
  CLI::Option* length =
      add_option(remesh, "--edge-length", arguments.edge_length)->check(number(1e-6, 1))->default_str("");
  add_option(remesh, "--faces", arguments.faces, " [as many as there are]")
      ->check(whole_number(1, 5'000'000))
      ->default_str("")
      ->excludes(length);
  add_option(remesh, "--sharp-angle", arguments.remesh.sharp_angle)->check(number(0, 180));
  add_option(remesh, "--remesh-iterations", arguments.remesh.iterations)->check(whole_number(1, 100));
  CLI::App& simplify = writing_command(program, "simplify", "Fewer faces, the flattest parts first", arguments);
  CLI::Option* faces =
      add_option(simplify, "--faces", arguments.faces)->check(whole_number(1, 1'000'000'000))->default_str("");
  add_option(simplify, "--reduction", arguments.reduction)
      ->check(number(0, 1, RangeEnds::kOpenAbove))
      ->default_str("")
      ->excludes(faces);
  program.add_common({"--keep-going", "--threads", "--json"});
  return program.run(argc, argv, [&] {
    const CommonOptions& common = program.common;
    using mesh_health::StepReport;
    if (check.parsed()) {
      check_files(arguments, common);
      return;
    }
    refuse_given(program.app, {"--keep-going"}, "applies only to check, which takes several files");
    if (repair.parsed()) {
      const auto carry = [&](const Asset& asset, mesh_health::MeshResult& result) {
        mesh_health::Repaired surface;
        surface.mesh = std::move(result.mesh);
        surface.place = std::move(result.place);
        return mesh_health::carry_to_repaired(asset, surface, arguments.repair);
      };
      const auto work = [&](const Mesh& mesh, const StepReport&) { return repair_work(mesh, arguments.repair); };
      make_mesh(arguments, "repairing", work, carry, common);
    } else if (wrap.parsed()) {
      const auto work = [&](const Mesh& mesh, const StepReport& report) {
        return wrap_work(mesh, arguments.wrap, report);
      };
      make_mesh(arguments, "wrapping", work, carry_by_place, common);
    } else if (remesh.parsed()) {
      const auto work = [&](const Mesh& mesh, const StepReport& report) {
        return remesh_work(mesh, arguments, report);
      };
      make_mesh(arguments, "remeshing", work, carry_by_place, common);
    } else {
      if (simplify.get_option("--faces")->count() + simplify.get_option("--reduction")->count() == 0)
        throw InputError("", "--faces", "say how many faces are wanted, or --reduction");
      const auto work = [&](const Mesh& mesh, const StepReport&) { return simplify_work(mesh, arguments); };
      make_mesh(arguments, "simplifying", work, carry_by_place, common);
    }
  });
}
