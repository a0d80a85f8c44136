// Makes a stream of shards and trains on it, kills both programs at random moments, starts them again, and compares
// every shard with that of a preparer left alone, byte for byte. The training must follow the stream over its kills
// without losing the shards of its checkpoint, and the disk must never hold more than two shards beyond those asked.
//   stream_kill_and_resume <anigen-prepare> <anigen-train>       KILLS=10 in the environment for more than 3 of each
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <set>
#include <thread>

#include "anigen/core/random.h"
#include "anigen/core/run_folder.h"
#include "anigen/core/table.h"
#include "tests/e2e/prepare_support.h"
#include "tests/support/paths.h"

namespace {

namespace fs = std::filesystem;
using namespace anigen::test;
using anigen::StreamFolder;
using anigen::StreamIndex;

constexpr std::size_t kShards = 2, kMostBeyond = 2;
constexpr std::uint64_t kMade = 5;  // shards in all

constexpr char kConfig[] = R"({
  "models": {"model": {"name": "SkinAutoEncoder", "args": {
    "encoder_config": {"skin_feat_channels": 4, "skl_pos_embed_freq": 6, "jp_embed_dim": 32,
                       "jp_embedder_config": {"hidden_dim": 32, "depth": 1, "jp_embed_attn": true}},
    "decoder_config": {"model_type": "tree", "skin_feat_channels": 4, "model_channels": 16, "num_blocks": 2}}}},
  "dataset": {"name": "AniGenSparseFeat2Skeleton", "args": {"test_mode": false, "split": "splits/train.txt"}},
  "trainer": {"name": "AniGenSkinAETrainer", "args": {
    "max_steps": 1000000, "batch_size": 2, "batch_split": 1, "num_skin_samples": 64, "seed": 7,
    "optimizer": {"name": "AdamW", "args": {"lr": 0.003}}, "ema_rate": [0.99], "fp16_mode": "none",
    "i_log": 5, "i_print": 0, "i_save": 10, "i_sample": 0}}})";

using Shards = std::map<std::uint64_t, Contents>;

struct Setup {
  std::string prepare, train;
  fs::path folder;

  pid_t start_preparer(const std::string& out) const {
    return start_program({prepare, "--output", (folder / out).string(), "--stream", "3", "--shards",
                          std::to_string(kShards), "--stop-after", std::to_string(kMade), "--no-assets", "--workers",
                          "2", "--quiet", "--log-level", "off"});
  }
  pid_t start_training(const std::string& stream, const std::string& out) const {
    return start_program({train, "--config", (folder / "config.json").string(), "--dataset", (folder / stream).string(),
                          "--output", (folder / out).string(), "--threads", "1", "--quiet"});
  }
};

bool ended(pid_t child, int& status) {
  const pid_t found = ::waitpid(child, &status, WNOHANG);
  require(found >= 0, "cannot wait");
  return found == child;
}

// Kills a program that may have ended by itself, which only success excuses.
void kill_program(pid_t child, const std::string& what) {
  ::kill(child, SIGKILL);
  const int status = wait_for(child);
  require(status == 0 || status == -SIGKILL, what + " failed with status " + std::to_string(status));
}

// Every shard that may be read now, and how many folders of shards there are, whole or not.
void collect(const StreamFolder& stream, Shards& shards) {
  for (const std::uint64_t number : stream.read_index().shards) {
    Contents found = dataset_contents(stream.shard(number));
    const auto known = shards.find(number);
    if (known == shards.end()) {
      shards.emplace(number, std::move(found));
    } else {
      require_same(known->second, found, "shard " + std::to_string(number) + " changed");
    }
  }
}

void require_little_on_disk(const StreamFolder& stream) {
  std::set<std::string> numbers;
  for (const auto& entry : fs::directory_iterator(stream.root)) {
    const std::string name = entry.path().filename().string();
    if (name.rfind("shard-", 0) == 0 || name.rfind(".making-", 0) == 0) numbers.insert(name.substr(name.find('-')));
  }
  require(numbers.size() <= kShards + kMostBeyond, std::to_string(numbers.size()) + " shards are on the disk");
}

// The shards of a preparer that nothing disturbs, with this test in place of a training.
Shards undisturbed(const Setup& setup) {
  const StreamFolder stream{setup.folder / "whole"};
  const pid_t child = setup.start_preparer("whole");
  Shards shards;
  int status = 0;
  for (std::uint64_t seen = 0; !ended(child, status);) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    if (!stream.exists() || stream.read_index().generation == seen) continue;
    seen = stream.read_index().generation;
    collect(stream, shards);
    stream.mark_used(seen);
  }
  require(status == 0, "the undisturbed preparer failed");
  collect(stream, shards);
  require(shards.size() == kMade, "the undisturbed preparer made " + std::to_string(shards.size()) + " shards");
  return shards;
}

void wait_for_first_generation(const StreamFolder& stream, pid_t preparer) {
  int status = 0;
  while (!stream.exists() || stream.read_index().generation == 0) {
    require(!ended(preparer, status), "the preparer ended before its first generation");
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
}

void run(const Setup& setup, int kills) {
  anigen::write_file_atomically(setup.folder / "config.json", kConfig);
  const Shards whole = undisturbed(setup);

  const StreamFolder stream{setup.folder / "killed"};
  anigen::Rng rng(static_cast<std::uint64_t>(::getpid()), "kill moments");
  const auto wait = [&](double most) {
    std::this_thread::sleep_for(std::chrono::duration<double>(rng.uniform(0.05, most)));
  };
  // A preparer killed before its first generation is there.
  pid_t preparer = setup.start_preparer("killed");
  wait(1.0);
  kill_program(preparer, "the preparer");
  preparer = setup.start_preparer("killed");
  wait_for_first_generation(stream, preparer);

  Shards found;
  for (int kill = 0; kill < kills; ++kill) {
    const pid_t training = setup.start_training("killed", "run");
    wait(3.0);
    if (rng.chance(0.5)) kill_program(training, "the training");
    kill_program(preparer, "the preparer");
    if (::kill(training, 0) == 0) {
      wait(1.0);  // the training goes on without a preparer
      kill_program(training, "the training");
    }
    collect(stream, found);
    require_little_on_disk(stream);
    preparer = setup.start_preparer("killed");
  }
  // Undisturbed to the last shard, and a checkpoint that has it.
  const pid_t training = setup.start_training("killed", "run");
  int status = 0;
  const auto begin = std::chrono::steady_clock::now();
  while (!ended(preparer, status)) {
    int other = 0;
    require(!ended(training, other), "the training ended with status " + std::to_string(other));
    require(std::chrono::steady_clock::now() - begin < std::chrono::minutes(5), "the stream does not go on");
    require_little_on_disk(stream);
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  require(status == 0, "the preparer failed");
  const std::uint64_t last = stream.read_index().generation;
  while (stream.used_generation() < last) {
    require(std::chrono::steady_clock::now() - begin < std::chrono::minutes(5), "the last generation is not used");
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  ::kill(training, SIGINT);
  const int left = wait_for(training);
  require(left == 130, "Ctrl-C ended the training with status " + std::to_string(left));

  collect(stream, found);
  for (const auto& [number, contents] : found)
    require_same(whole.at(number), contents, "shard " + std::to_string(number));
  require(found.count(kMade - 1) == 1, "the last shard was not shown");
  const std::string log = anigen::read_file(setup.folder / "run" / "log.txt");
  require(log.find("are gone") == std::string::npos, "shards of a checkpoint were removed:\n" + log);
  const anigen::CsvTable table = anigen::read_csv(setup.folder / "run" / "metrics.csv");
  std::vector<int> steps;
  for (const auto& row : table.rows) steps.push_back(std::stoi(row[0]));
  require(std::is_sorted(steps.begin(), steps.end()) && std::adjacent_find(steps.begin(), steps.end()) == steps.end(),
          "metrics.csv holds two histories");
  std::printf("%zu generations; %zu of %zu shards compared, all equal\n", static_cast<std::size_t>(last), found.size(),
              whole.size());
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) return std::fprintf(stderr, "usage: stream_kill_and_resume <anigen-prepare> <anigen-train>\n"), 2;
  const char* kills = std::getenv("KILLS");
  try {
    const TemporaryFolder folder;
    run({argv[1], argv[2], folder.path()}, kills != nullptr ? std::max(1, std::atoi(kills)) : 3);
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "stream_kill_and_resume: %s\n", error.what());
    return 1;
  }
}
