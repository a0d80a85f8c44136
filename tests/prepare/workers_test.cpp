#include "anigen/prepare/workers.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "anigen/core/error.h"

namespace anigen::prepare {
namespace {

// A worker as a shell script: echoes its task as the result, unless the task tells it to misbehave.
constexpr char kScript[] = R"(
read settings
case "$settings" in *stillborn*) exit 3;; *fatal*) echo '{"event":"fatal","message":"no weights","bad_input":true}'; exit 2;; esac
echo '{"event":"ready"}'
while read line; do
  echo '{"event":"step","asset":"a","variant":0,"step":"voxels","fingerprint":"f"}'
  case "$line" in
    *crash*) kill -SEGV $$ ;;
    *hang*) exec sleep 100 ;;
    *eat*) exec tail /dev/zero ;;
    *quit*) exit 5 ;;
    *babble*) echo 'this is no message' ;;
  esac
  echo "{\"event\":\"done\",\"result\":$line}"
done
)";

PoolOptions options(const std::string& settings = "{}") {
  PoolOptions options;
  options.command = {"/bin/sh", "-c", kScript};
  options.settings = Json::parse(settings);
  options.workers = 2;
  return options;
}

struct Log {
  std::vector<std::string> done;
  std::vector<WorkerDeath> deaths;
};

/// Runs the words as tasks; a task whose worker died is replaced by the word "instead", once.
Log run(PoolOptions pool_options, const std::vector<std::string>& words) {
  Log log;
  std::size_t next = 0;
  PoolClient client;
  client.next = [&]() -> std::optional<Json> {
    if (next == words.size()) return std::nullopt;
    return Json(words[next++]);
  };
  client.done = [&](const Json& task, const Json& result) {
    EXPECT_EQ(task, result);
    log.done.push_back(result.get<std::string>());
  };
  client.died = [&](const Json&, const WorkerDeath& death) -> std::optional<Json> {
    log.deaths.push_back(death);
    return Json("instead");
  };
  WorkerPool(std::move(pool_options)).run(client);
  std::sort(log.done.begin(), log.done.end());
  return log;
}

TEST(WorkerPool, DoesEveryTaskOnce) {
  std::vector<std::string> words;
  for (int i = 0; i < 50; ++i) words.push_back("task " + std::to_string(100 + i));
  const Log log = run(options(), words);
  EXPECT_EQ(log.done, words);
  EXPECT_TRUE(log.deaths.empty());
}

TEST(WorkerPool, ReplacesAWorkerThatCrashes) {
  const Log log = run(options(), {"a", "crash", "b", "quit"});
  EXPECT_EQ(log.done, (std::vector<std::string>{"a", "b", "instead", "instead"}));
  ASSERT_EQ(log.deaths.size(), 2u);
  std::string reasons;
  for (const WorkerDeath& death : log.deaths) {
    EXPECT_EQ(death.cause, WorkerDeath::Cause::kCrash);
    EXPECT_EQ(death.at.at("step"), "voxels");
    reasons += death.reason + "; ";
  }
  EXPECT_NE(reasons.find("signal 11"), std::string::npos) << reasons;
  EXPECT_NE(reasons.find("status 5"), std::string::npos) << reasons;
}

TEST(WorkerPool, EndsAWorkerThatTakesTooLong) {
  PoolOptions limited = options();
  limited.timeout = 0.3;
  const Log log = run(limited, {"a", "hang", "b"});
  EXPECT_EQ(log.done, (std::vector<std::string>{"a", "b", "instead"}));
  ASSERT_EQ(log.deaths.size(), 1u);
  EXPECT_EQ(log.deaths[0].cause, WorkerDeath::Cause::kTimeout);
  EXPECT_NE(log.deaths[0].reason.find("0.3 s"), std::string::npos);
}

TEST(WorkerPool, EndsAWorkerThatGrowsTooLarge) {
  PoolOptions limited = options();
  limited.memory_bytes = std::uint64_t{64} << 20;
  const Log log = run(limited, {"a", "eat", "b"});
  EXPECT_EQ(log.done, (std::vector<std::string>{"a", "b", "instead"}));
  ASSERT_EQ(log.deaths.size(), 1u);
  EXPECT_EQ(log.deaths[0].cause, WorkerDeath::Cause::kMemory);
  EXPECT_NE(log.deaths[0].reason.find("64 MB"), std::string::npos);
}

TEST(WorkerPool, GivesUpWhenWorkersCannotStart) {
  EXPECT_THROW(run(options(R"({"how": "stillborn"})"), {"a"}), Error);
  PoolOptions absent = options();
  absent.command = {"/nonexistent/worker"};
  EXPECT_THROW(run(absent, {"a"}), Error);
}

TEST(WorkerPool, PassesOnWhatEndsTheWholeRun) {
  EXPECT_THROW(run(options(R"({"how": "fatal"})"), {"a"}), InputError);
  EXPECT_THROW(run(options(), {"babble"}), InputError);
}

}  // namespace
}  // namespace anigen::prepare
