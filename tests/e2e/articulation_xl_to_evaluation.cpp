// An Articulation-XL shard goes the whole way: prepare with a seeded split, train SkinAE a few steps, evaluate on the
// test split.
//   articulation_xl_to_evaluation <anigen-prepare> <anigen-train> <anigen-eval> [<python3> <write_articulation_xl.py>]
// With the last two numpy writes the shards, else this program does. Exit status 77: numpy is not installed.
#include <cstdio>

#include "anigen/core/config_file.h"
#include "anigen/core/csv.h"
#include "anigen/core/json.h"
#include "anigen/core/random.h"
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
  require(run_program({programs.prepare, "--out", data, "--input", (folder / "in").string(), "--test-count", "3",
                       "--seed", "5", "--quiet"}) == 0,
          "anigen-prepare failed");
  const anigen::CsvTable table = anigen::read_csv(folder / "data" / "metadata.csv");
  require(table.rows.size() == 12, "not every sample became an asset");
  const std::string test = anigen::read_file(folder / "data" / "splits" / "test.txt");
  require(test.size() == 3 * 65, "the test split does not hold three ids");

  anigen::write_file_atomically(folder / "config.json", kConfig);
  require(run_program({programs.train, "--config", (folder / "config.json").string(), "--data-dir", data, "--output",
                       model, "--threads", "1", "--quiet"}) == 0,
          "anigen-train failed");
  require(run_program({programs.eval, "--gt", data, "--split", data + "/splits/test.txt", "--skin-ae", model, "--out",
                       (folder / "report").string(), "--quiet"}) == 0,
          "anigen-eval failed");
  const anigen::Json metrics = anigen::read_json(folder / "report" / "metrics.json");
  std::size_t mentioned = 0;
  for (std::size_t at = 0; at < test.size(); at += 65) {
    mentioned += metrics.dump().find(test.substr(at, 64)) != std::string::npos;
  }
  require(mentioned == 3, "the evaluation does not name the three test assets");
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
