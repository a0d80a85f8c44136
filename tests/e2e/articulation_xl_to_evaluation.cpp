// An Articulation-XL shard goes the whole way: prepare with a seeded split, train SkinAE a few steps, evaluate on the
// test split. Then three programs' predictions are compared on a split of uuids: ours, called by sha256, and two
// others', called by uuid, against the dataset and against the shard itself.
//   articulation_xl_to_evaluation <anigen-prepare> <anigen-train> <anigen-eval> [<python3> <write_articulation_xl.py>]
// With the last two numpy writes the shards, else this program does. Exit status 77: numpy is not installed.
#include <cstdio>

#include "anigen/core/config.h"
#include "anigen/core/random.h"
#include "anigen/core/table.h"
#include "tests/e2e/prepare_support.h"
#include "tests/support/paths.h"
#include "tests/support/rig_files.h"

namespace {

namespace fs = std::filesystem;
using namespace anigen::test;

constexpr char kConfig[] = R"({
  "models": {"model": {"name": "SkinAutoEncoder", "args": {
    "encoder_config": {"skin_feat_channels": 4, "skl_pos_embed_freq": 6, "jp_embed_dim": 32,
                       "jp_embedder_config": {"hidden_dim": 32, "depth": 1, "jp_embed_attn": true}},
    "decoder_config": {"model_type": "tree", "skin_feat_channels": 4, "model_channels": 16, "num_blocks": 2}}}},
  "dataset": {"name": "AniGenSparseFeat2Skeleton",
              "args": {"test_mode": false, "split": "splits/train.txt", "eval_split": "splits/test.txt"}},
  "trainer": {"name": "AniGenSkinAETrainer", "args": {
    "max_steps": 5, "batch_size": 2, "batch_split": 1, "num_skin_samples": 64, "seed": 7,
    "optimizer": {"name": "AdamW", "args": {"lr": 0.003}}, "fp16_mode": "none",
    "i_log": 1, "i_print": 0, "i_save": 5, "i_sample": 0}}})";

/// A crooked ribbon of quads along a chain of joints.
RigFile ribbon(std::size_t number) {
  anigen::Rng rng(3, "ribbon", number);
  const int joints = 4 + static_cast<int>(rng.index(4));
  RigFile rig;
  rig.uuid = "uuid-" + std::to_string(number);
  rig.vertices.clear();
  rig.faces.clear();
  rig.joints.clear();
  rig.parents.clear();
  for (int j = 0; j < joints; ++j) {
    const double x = 0.3 * j, y = 0.2 * rng.uniform(), z = 0.2 * rng.uniform();
    rig.joints.insert(rig.joints.end(), {x, y, z});
    rig.parents.push_back(j - 1);
    for (const double side : {-0.1, 0.1}) {
      rig.vertices.insert(rig.vertices.end(),
                          {static_cast<float>(x), static_cast<float>(y + side), static_cast<float>(z + 0.05)});
    }
    if (j > 0) rig.faces.insert(rig.faces.end(), {2 * j - 2, 2 * j - 1, 2 * j, 2 * j, 2 * j - 1, 2 * j + 1});
  }
  rig.skin.assign(static_cast<std::size_t>(2 * joints * joints), 0.0f);
  for (int v = 0; v < 2 * joints; ++v) {
    rig.skin[static_cast<std::size_t>(v * joints + v / 2)] += 0.75f;
    rig.skin[static_cast<std::size_t>(v * joints + (v / 2 + 1) % joints)] += 0.25f;
  }
  rig.skin_rows = 2 * joints;
  rig.skin_columns = joints;
  return rig;
}

constexpr int kSkipped = 77;

// Both spellings of the sparse keys, in two shards.
void write_shards(const fs::path& folder) {
  std::vector<RigFile> first, second;
  for (std::size_t i = 0; i < 12; ++i) (i < 7 ? first : second).push_back(ribbon(i));
  write_articulation_xl(folder / "articulation_xl.npz", first);
  XlOptions plural;
  plural.row_suffix = "s";
  write_articulation_xl(folder / "articulation_xl_more.npz", second, plural);
}

struct Programs {
  std::string prepare, train, eval;
  std::vector<std::string> writer;  ///< of the shards; empty: this program
};

void write_lines(const fs::path& file, const std::vector<std::string>& lines) {
  std::string text;
  for (const std::string& line : lines) text += line + "\n";
  anigen::write_file_atomically(file, text);
}

/// Three folders of predictions on one split of uuids, one command each for the dataset and a shard.
void compare_three(const Programs& programs, const TemporaryFolder& folder) {
  const fs::path shards = folder / "in", data = folder / "by_uuid";
  const anigen::CsvTable known = anigen::read_csv(folder / "data" / "metadata.csv");
  std::vector<std::string> of_first, uuids;  // two test assets of the first shard, and one more of the second
  for (std::size_t row = 0; row < known.rows.size(); ++row) {
    const std::string& uuid = known.cell(row, "uuid");
    require(known.cell(row, "local_path") == known.cell(row, "source_path") + "#" + uuid, "metadata.csv lost a name");
    const bool first = known.cell(row, "source_path") == "articulation_xl.npz";
    if (first && of_first.size() < 2) of_first.push_back(uuid);
    if ((first && uuids.size() < 2) || (!first && uuids.size() == 2)) uuids.push_back(uuid);
  }
  require(of_first.size() == 2 && uuids.size() == 3, "the shards are not those expected");
  write_lines(folder / "uuids.txt", uuids);
  write_lines(folder / "first.txt", of_first);
  require(run_program({programs.prepare, "--output", data.string(), "--input", shards.string(), "--test-split",
                       (folder / "uuids.txt").string(), "--quiet"}) == 0,
          "anigen-prepare refused a split of uuids");
  const anigen::CsvTable table = anigen::read_csv(data / "metadata.csv");
  std::size_t tests = 0;
  for (std::size_t row = 0; row < table.rows.size(); ++row) {
    if (!table.flag(row, "is_test", false, "")) continue;
    ++tests;
    const std::string &sha = table.cell(row, "sha256"), &uuid = table.cell(row, "uuid");
    for (const std::string& file :
         {"ours/" + sha + ".glb", "unirig/" + uuid + ".glb", "puppeteer/" + uuid + "/raw_data.npz"})
      fs::create_directories((folder / file).parent_path());
    fs::copy_file(data / "assets" / (sha + ".glb"), folder / ("ours/" + sha + ".glb"));
    fs::copy_file(data / "assets" / (sha + ".glb"), folder / ("unirig/" + uuid + ".glb"));
    fs::copy_file(data / "skeleton" / sha / "skeleton_voxelized.npz", folder / ("puppeteer/" + uuid + "/raw_data.npz"));
  }
  require(tests == 3, "the split of uuids does not make three test assets");

  const auto evaluate = [&](const fs::path& truth, const char* split, const std::vector<std::string>& more) {
    std::vector<std::string> words{programs.eval};
    for (const char* name : {"ours", "unirig", "puppeteer"}) {
      words.insert(words.end(), {"--pred", std::string(name) + "=" + (folder / name).string()});
    }
    words.insert(words.end(), {"--dataset", truth.string(), "--split", (folder / split).string(), "--output",
                               (folder / "compared").string(), "--metrics", "skeleton,transport", "--no-icp",
                               "--no-report", "--quiet"});
    words.insert(words.end(), more.begin(), more.end());
    return run_program(words, folder / "screen.txt");
  };
  const auto require_pairs = [&](std::size_t pairs) {
    const anigen::Json metrics = anigen::read_json(folder / "compared" / "metrics.json");
    for (const char* name : {"ours", "unirig", "puppeteer"}) {
      require(metrics["pairing"][name]["paired"] == pairs && metrics["pairing"][name]["missing"].empty(),
              std::string(name) + " does not pair with its ground truths");
      require(metrics["methods"][name]["summary"]["j2j"]["mean"].get<double>() < 1e-5,
              std::string(name) + " is paired with another asset");
    }
    return metrics;
  };
  require(evaluate(data, "uuids.txt", {}) == 0, "anigen-eval failed on the dataset");
  require(require_pairs(3)["settings"]["transport"]["solver"] == "exact", "transport is not exact by default");
  require(evaluate(shards / "articulation_xl.npz", "first.txt",
                   {"--transport", "sinkhorn", "--sinkhorn-epsilon", "0.01"}) == 0,
          "anigen-eval failed on the shard");
  require(require_pairs(2)["settings"]["transport"]["epsilon_wasserstein"] == 0.01, "--sinkhorn-epsilon got lost");
  require(anigen::read_file(folder / "screen.txt").find("Sinkhorn iterations; epsilon 0.01") != std::string::npos,
          "the table does not say how transport was computed");
  constexpr int kBadInput = 2;
  require(evaluate(data, "uuids.txt", {"--sinkhorn-epsilon", "0.01"}) == kBadInput,
          "--sinkhorn-epsilon without Sinkhorn is accepted");
}

/// @return whether the shards could be written
bool run(const Programs& programs) {
  const TemporaryFolder folder;
  if (programs.writer.empty()) {
    write_shards(folder / "in");
  } else {
    std::vector<std::string> command = programs.writer;
    command.push_back((folder / "in").string());
    const int status = run_program(command);
    if (status == kSkipped) return false;
    require(status == 0, "the writer of the shards failed");
  }
  const std::string data = (folder / "data").string(), model = (folder / "run").string();
  require(run_program({programs.prepare, "--output", data, "--input", (folder / "in").string(), "--test-count", "3",
                       "--seed", "5", "--quiet"}) == 0,
          "anigen-prepare failed");
  const anigen::CsvTable table = anigen::read_csv(folder / "data" / "metadata.csv");
  require(table.rows.size() == 12, "not every sample became an asset");
  const std::string test = anigen::read_file(folder / "data" / "splits" / "test.txt");
  require(test.size() == 3 * 65, "the test split does not hold three ids");

  anigen::write_file_atomically(folder / "config.json", kConfig);
  require(run_program({programs.train, "--config", (folder / "config.json").string(), "--dataset", data, "--output",
                       model, "--threads", "1", "--quiet"}) == 0,
          "anigen-train failed");
  require(run_program({programs.eval, "--dataset", data, "--split", data + "/splits/test.txt", "--skin-ae", model,
                       "--output", (folder / "report").string(), "--quiet"}) == 0,
          "anigen-eval failed");
  const anigen::Json metrics = anigen::read_json(folder / "report" / "metrics.json");
  std::size_t mentioned = 0;
  for (std::size_t at = 0; at < test.size(); at += 65)
    mentioned += metrics.dump().find(test.substr(at, 64)) != std::string::npos;
  require(mentioned == 3, "the evaluation does not name the three test assets");
  compare_three(programs, folder);
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4 && argc != 6) {
    std::fprintf(stderr,
                 "usage: articulation_xl_to_evaluation <anigen-prepare> <anigen-train> <anigen-eval> [<python3> "
                 "<write_articulation_xl.py>]\n");
    return 2;
  }
  try {
    if (!run({argv[1], argv[2], argv[3], {argv + 4, argv + argc}})) {
      std::printf("skipped: numpy is not installed\n");
      return kSkipped;
    }
    std::printf("12 samples prepared, trained on and evaluated\n");
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "articulation_xl_to_evaluation: %s\n", error.what());
    return 1;
  }
}
