// Forty rigs and ten files that are broken in ten ways: forty assets, ten named failures, exit status and summary.
//   prepare_corrupt_inputs <anigen-prepare>
#include <cstdio>
#include <set>

#include "anigen/core/config.h"
#include "anigen/core/table.h"
#include "tests/e2e/prepare_support.h"
#include "tests/support/paths.h"
#include "tests/support/rig_files.h"

namespace {

namespace fs = std::filesystem;
using namespace anigen::test;

constexpr int kGood = 40;

RigFile rig_number(int i) {
  RigFile rig;
  for (float& x : rig.vertices) x *= 1.0f + 0.01f * static_cast<float>(i);  // contents must differ
  rig.uuid = "sample" + std::to_string(i);
  return rig;
}

void write_good(const fs::path& folder) {
  for (int i = 0; i < kGood - 10; ++i) write_glb(folder / ("glb" + std::to_string(i) + ".glb"), rig_number(i));
  for (int i = kGood - 10; i < kGood - 5; ++i)
    write_rig_npz(folder / ("arrays" + std::to_string(i) + ".npz"), rig_number(i));
  std::vector<RigFile> samples;
  for (int i = kGood - 5; i < kGood; ++i) samples.push_back(rig_number(i));
  write_articulation_xl(folder / "shard.npz", samples);
}

std::set<std::string> write_broken(const fs::path& folder) {
  const std::string glb = anigen::read_file(folder / "glb0.glb"), npz = anigen::read_file(folder / "arrays30.npz");
  std::string huge = glb, noise = glb;
  huge.replace(12, 4, "\xff\xff\xff\x7f");  // a chunk of 2 GiB
  for (std::size_t i = 100; i < noise.size(); i += 7) noise[i] = static_cast<char>(i * 31);
  const std::map<std::string, std::string> files{
      {"x_empty.glb", ""},
      {"x_cut.glb", glb.substr(0, glb.size() / 2)},
      {"x_huge_chunk.glb", huge},
      {"x_noise.glb", noise},
      {"x_text.gltf", "this is no JSON"},
      {"x_no_skin.gltf", R"({"asset": {"version": "2.0"}, "scenes": [{"nodes": []}], "scene": 0})"},
      {"x_escapes.gltf", R"({"asset": {"version": "2.0"}, "buffers": [{"uri": "../../etc/passwd", "byteLength": 4}]})"},
      {"x_cut.npz", npz.substr(0, npz.size() / 2)},
      {"x_noise.pt", std::string(1000, 'x')},
      {"x_noise.fbx", "Kaydara FBX Binary  " + std::string(500, '\x7f')},
  };
  std::set<std::string> names;
  for (const auto& [name, bytes] : files) {
    anigen::write_file_atomically(folder / name, bytes);
    names.insert("in/" + name);
  }
  return names;
}

void run(const std::string& program) {
  const TemporaryFolder folder;
  write_good(folder / "in");
  const std::set<std::string> broken = write_broken(folder / "in");
  const fs::path out = folder / "out";
  std::vector<std::string> command{
      program,   "--output",    out.string(), "--input", (folder / "in").string(), "--json",
      "--quiet", "--log-level", "off",        "--only",  "import,skeleton,voxels"};
  require(run_program(command, folder / "failed.json") == 1, "broken files are no failure");
  fs::remove_all(out);
  command.push_back("--keep-going");
  require(run_program(command, folder / "summary.json") == 0, "broken files stopped the run");
  const anigen::Json summary = anigen::read_json(folder / "summary.json");
  require(summary.at("prepared") == kGood, "prepared " + summary.at("prepared").dump());
  require(summary.at("rejected").size() == broken.size(), "rejected " + summary.at("rejected").dump(1));

  const anigen::CsvTable rejected = anigen::read_csv(out / "rejected.csv");
  std::set<std::string> named;
  for (std::size_t row = 0; row < rejected.rows.size(); ++row) {
    named.insert(rejected.cell(row, "file_identifier"));
    require(!rejected.cell(row, "reason").empty(), "a rejection without a reason");
    std::printf("  %s: %s\n", rejected.cell(row, "file_identifier").c_str(), rejected.cell(row, "reason").c_str());
  }
  require(named == broken, "other files than the broken ones were rejected");
  require(anigen::read_csv(out / "metadata.csv").rows.size() == kGood, "not every good file has a row");
  const Contents files = dataset_contents(out);
  for (const char* kind : {"skeleton/", "voxels/", "records/"}) {
    std::size_t count = 0;
    for (const auto& [name, bytes] : files) count += name.rfind(kind, 0) == 0;
    require(count == (std::string(kind) == "voxels/" ? 2 : 1) * kGood, std::string("wrong number of files in ") + kind);
  }
  // Repeating costs nothing and changes nothing; who wants to know is told by the exit status.
  require(run_program(command, folder / "again.json") == 0, "repeating failed");
  require(anigen::read_json(folder / "again.json").at("reused") == kGood, "repeating did not reuse everything");
  require_same(files, dataset_contents(out), "repeated");
  command.push_back("--strict");
  require(run_program(command, folder / "strict.json") == 1, "--strict did not exit with 1");
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) return std::fprintf(stderr, "usage: prepare_corrupt_inputs <anigen-prepare>\n"), 2;
  try {
    run(argv[1]);
    std::printf("%d assets and ten named failures\n", kGood);
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "prepare_corrupt_inputs: %s\n", error.what());
    return 1;
  }
}
