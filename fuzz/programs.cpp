#include <arpa/inet.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <cstdint>
#include <filesystem>
#include <string>

#include "anigen/core/files.h"
#include "anigen/core/private_folder.h"
#include "anigen/engine/files.h"
#include "anigen/experiment/file.h"
#include "anigen/experiment/plan.h"
#include "anigen/studio/api.h"
#include "anigen/studio/job_runner.h"
#include "anigen/studio/job_store.h"
#include "anigen/studio/job_work.h"
#include "anigen/studio/server.h"
#include "fuzz/targets.h"
#include "tests/support/hinged_boxes.h"

namespace anigen::fuzz {

namespace {

namespace fs = std::filesystem;

// --- Requests of the studio ---

/// A studio that listens on the loopback network, with one finished rig, j000001. Its jobs end at once, without work.
class Studio {
 public:
  Studio() {
    studio::JobRecord record;
    record.kind = "rig";
    record.name = record.names["file"] = "hinge.glb";
    const Asset hinge = test::hinged_boxes(0.1F, 0.3F);
    record = store_.create(record, {{"file", ".glb", engine::save_bytes(hinge)}});
    first_ = record.id;
    engine::save(hinge, store_.folder(first_) / studio::kRiggedFile);
    store_.update(first_, [](studio::JobRecord& job) { job.state = studio::JobState::kDone; });
    runner_ = std::make_unique<studio::JobRunner>(
        store_, [](const fs::path&, Job&, studio::JobRecord&) {}, 4);
    api_ = std::make_unique<studio::Api>(store_, *runner_);
    studio::ServerOptions options;
    options.most_bytes = std::size_t{1} << 20;
    server_ = std::make_unique<studio::Server>(*api_, options);
  }

  /// Sends the bytes of one connection. @return the answer
  std::string answer(const std::string& bytes) const {
    const int connection = ::socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(server_->port()));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const timeval patience{20, 0};
    ::setsockopt(connection, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    // The port is free again at once, or thousands of connections a second use up all there are.
    const linger at_once{1, 0};
    ::setsockopt(connection, SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
    require(::connect(connection, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0,
            "the studio takes no connection");
    for (std::size_t sent = 0; sent < bytes.size();) {
      const ssize_t taken = ::send(connection, bytes.data() + sent, bytes.size() - sent, MSG_NOSIGNAL);
      if (taken <= 0) break;  // it has refused what it saw
      sent += static_cast<std::size_t>(taken);
    }
    ::shutdown(connection, SHUT_WR);
    std::string came;
    char piece[4096];
    ssize_t got = 0;
    while ((got = ::recv(connection, piece, sizeof piece, 0)) > 0) came.append(piece, static_cast<std::size_t>(got));
    require(got == 0 || errno != EAGAIN, "the studio does not answer");
    ::close(connection);
    return came;
  }

  /// Removes the jobs that a request made, and its edit of the first one.
  void clean() {
    for (const studio::JobRecord& job : store_.list()) {
      if (job.id == first_) continue;
      runner_->cancel(job.id);
      while (store_.find(job.id) && !store_.remove(job.id)) ::usleep(100);
    }
    std::error_code ignored;
    fs::remove(store_.folder(first_) / studio::kEditedFile, ignored);
    require(store_.find(first_).has_value(), "a job is gone that nobody removed");
  }

  /// The first job, which a request may remove, is there.
  bool is_whole() const { return store_.find(first_).has_value(); }

 private:
  PrivateFolder folder_;
  studio::JobStore store_{folder_.path()};
  std::string first_;
  std::unique_ptr<studio::JobRunner> runner_;
  std::unique_ptr<studio::Api> api_;
  std::unique_ptr<studio::Server> server_;
};

void answer_request(const std::string& bytes) {
  static std::unique_ptr<Studio> studio;
  if (!studio) studio = std::make_unique<Studio>();
  const std::string answer = studio->answer(bytes);
  if (!answer.empty()) {
    require(answer.rfind("HTTP/1.1 ", 0) == 0, "an answer is not HTTP");
    require(answer.compare(9, 3, "500") != 0, ("a request failed inside: " + answer).c_str());
  }
  if (studio->is_whole())
    studio->clean();
  else
    studio.reset();
}

// --- Experiments ---

/// Reads and plans an experiment beside programs that are there and never called.
void plan_experiment(const std::string& bytes) {
  static const PrivateFolder folder;
  static const bool filled = [] {
    for (const char* program : {"prepare", "train", "encode", "eval", "generate", "rig", "animate"})
      write_file_atomically(folder / "bin" / (std::string("anigen-") + program), "");
    for (const char* name : {"train.json", "base.json"})
      write_file_atomically(folder / name, R"({"trainer": {"args": {"lr": 1, "max_steps": 5}}})");
    return true;
  }();
  static_cast<void>(filled);
  const fs::path file = as_file(bytes, ".json");
  if (experiment::read_collection(file)) return;
  const experiment::Experiment read = experiment::read_experiment(file);
  experiment::make_plan(read, {folder / "out", folder / "bin", "cpu"});
}

}  // namespace

std::map<std::string, Target> program_targets() { return {{"http", answer_request}, {"experiment", plan_experiment}}; }

}  // namespace anigen::fuzz
