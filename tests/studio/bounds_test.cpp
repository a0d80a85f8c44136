#include "anigen/studio/server.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <httplib.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "anigen/core/files.h"
#include "tests/support/paths.h"

namespace anigen::studio {

namespace {

namespace fs = std::filesystem;

constexpr const char* kTenBytes = "0123456789";
constexpr const char* kHealth = "GET /health HTTP/1.1\r\nHost: 127.0.0.1\r\n";

/// A connection that is written to by hand.
class RawConnection {
 public:
  explicit RawConnection(int port) : socket_(::socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(::connect(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  }
  ~RawConnection() { ::close(socket_); }
  RawConnection(const RawConnection&) = delete;
  RawConnection& operator=(const RawConnection&) = delete;

  void send(const std::string& bytes) const { ::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL); }
  /// An answer has begun within these milliseconds.
  bool is_answered(int milliseconds) const {
    pollfd watched{socket_, POLLIN, 0};
    return ::poll(&watched, 1, milliseconds) > 0;
  }
  /// All that comes until the server closes the connection.
  std::string answer() const {
    std::string text;
    char piece[4096];
    for (ssize_t got = 0; (got = ::recv(socket_, piece, sizeof piece, 0)) > 0;)
      text.append(piece, static_cast<std::size_t>(got));
    return text;
  }
  std::string status() const {
    const std::string text = answer();
    return text.size() < 12 ? text : text.substr(9, 3);
  }

 private:
  int socket_;
};

/// A studio whose jobs make a file of ten bytes each.
class StudioBounds : public ::testing::Test {
 protected:
  void start(double head_seconds = 30.0) {
    store_ = std::make_unique<JobStore>(folder_.path());
    runner_ = std::make_unique<JobRunner>(*store_, [](const fs::path& place, Job&, JobRecord&) {
      write_file_atomically(place / "rigged.glb", kTenBytes);
    });
    api_ = std::make_unique<Api>(*store_, *runner_);
    ServerOptions options;
    options.head_seconds = head_seconds;
    options.page = test::source_dir() / "anigen/studio/page";
    server_ = std::make_unique<Server>(*api_, options);
  }
  void SetUp() override { start(); }
  void stop() {
    server_.reset();
    runner_.reset();
    api_.reset();
    store_.reset();
  }
  void TearDown() override { stop(); }

  std::string done_job() const {
    JobRecord record;
    record.kind = "rig";
    record.name = "a.obj";
    const std::string id = runner_->submit(record, {{"file", ".obj", "x"}})->id;
    for (int i = 0; i < 1000 && store_->find(id)->state != JobState::kDone; ++i)
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    EXPECT_EQ(store_->find(id)->state, JobState::kDone);
    return id;
  }

  httplib::Result ranged(const std::string& path, const std::string& range) const {
    httplib::Client client("127.0.0.1", server_->port());
    return client.Get(path, httplib::Headers{{"Range", range}});
  }

  std::string status_of(const std::string& request) const {
    const RawConnection connection(server_->port());
    connection.send(request);
    return connection.status();
  }

  test::TemporaryFolder folder_;
  std::unique_ptr<JobStore> store_;
  std::unique_ptr<JobRunner> runner_;
  std::unique_ptr<Api> api_;
  std::unique_ptr<Server> server_;
};

TEST_F(StudioBounds, SendsOneRangeOfAFile) {
  const std::string id = done_job(), file = "/v1/jobs/" + id + "/files/rigged.glb";
  const auto part = [&](const std::string& range, const std::string& bytes, const std::string& content) {
    const httplib::Result result = ranged(file, range);
    ASSERT_TRUE(result) << range;
    EXPECT_EQ(result->status, 206) << range;
    EXPECT_EQ(result->body, bytes) << range;
    EXPECT_EQ(result->get_header_value("Content-Range"), content) << range;
    EXPECT_EQ(result->get_header_value("Content-Length"), std::to_string(bytes.size())) << range;
  };
  part("bytes=0-3", "0123", "bytes 0-3/10");
  part("bytes=4-4", "4", "bytes 4-4/10");
  part("bytes=7-", "789", "bytes 7-9/10");
  part("bytes=-2", "89", "bytes 8-9/10");
  part("bytes=-99", kTenBytes, "bytes 0-9/10");
  part("bytes=8-9223372036854775807", "89", "bytes 8-9/10");
  for (const std::string range : {"bytes=10-", "bytes=99-100", "bytes=5-2", "bytes=-0"}) {
    const httplib::Result result = ranged(file, range);
    ASSERT_TRUE(result) << range;
    EXPECT_EQ(result->status, 416) << range;
    EXPECT_TRUE(Json::parse(result->body).contains("error")) << range;
  }
  EXPECT_EQ(ranged(file, "bytes=10-")->get_header_value("Content-Range"), "bytes */10");
  httplib::Client client("127.0.0.1", server_->port());
  EXPECT_EQ(client.Get(file)->status, 200);
  EXPECT_EQ(client.Get(file, httplib::Headers{{"Range", "bytes=0-3"}, {"If-Range", "\"x\""}})->body, kTenBytes);
  // Answers that are no files have no ranges.
  const httplib::Result job = ranged("/v1/jobs/" + id, "bytes=0-3");
  EXPECT_EQ(job->status, 200);
  EXPECT_EQ(Json::parse(job->body).at("id"), id);
  EXPECT_FALSE(job->has_header("Content-Range"));
  EXPECT_EQ(ranged("/", "bytes=0-3")->status, 200);
  EXPECT_TRUE(Json::parse(ranged("/v1/jobs/j777", "bytes=0-3")->body).contains("error"));
}

TEST_F(StudioBounds, RefusesSeveralRanges) {
  const std::string job = "/v1/jobs/" + done_job();
  std::string many = "bytes=0-";
  for (int i = 0; i < 1500; ++i) many += ",0-";
  for (const std::string& path : {job + "/files/rigged.glb", job, job + "/events", std::string("/")}) {
    for (const std::string& range : {many, std::string("bytes=0-1,2-3"), std::string("bytes=0-1%2C2-3"),
                                     std::string("bytes=0-1,0-1,5-2"), "bytes=" + std::string(5000, '0') + "-"}) {
      const httplib::Result result = ranged(path, range);
      ASSERT_TRUE(result) << path << " " << range;
      EXPECT_EQ(result->status, 416) << path << " " << range;
      EXPECT_NE(Json::parse(result->body).at("error").get<std::string>().find("one range"), std::string::npos);
    }
  }
  EXPECT_EQ(status_of(std::string(kHealth) + "\r\n"), "200");
}

TEST_F(StudioBounds, RefusesHeadsWithoutAnEnd) {
  const std::string long_text(200'000, 'a');
  EXPECT_EQ(status_of("GET /" + long_text), "431");
  EXPECT_EQ(status_of(kHealth + ("X: " + long_text)), "431");
  EXPECT_EQ(status_of(kHealth + ("X: " + long_text) + "\r\n\r\n"), "431");
  std::string many = kHealth, few = kHealth;
  for (int i = 0; i < 20'000; ++i) many += "X: 1\r\n";
  EXPECT_EQ(status_of(many + "\r\n"), "431");
  for (int i = 0; i < 7; ++i) few += "X: " + std::string(8000, 'a') + "\r\n";
  EXPECT_EQ(status_of(few + "\r\n"), "200") << "56 KiB";
  EXPECT_EQ(status_of("GET /\r\n\r\n"), "400");
}

TEST_F(StudioBounds, TakesHeadsInPieces) {
  const std::string request = std::string(kHealth) + "\r\n";
  for (std::size_t cut : {std::size_t{1}, request.size() - 3, request.size() - 2, request.size() - 1}) {
    const RawConnection connection(server_->port());
    connection.send(request.substr(0, cut));
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    connection.send(request.substr(cut));
    EXPECT_EQ(connection.status(), "200") << cut;
  }
  // Bytes that come with the end of a head begin its body.
  const std::string body = R"({"methods": ["curve"]})";
  const RawConnection connection(server_->port());
  connection.send("POST /v1/jobs/" + done_job() + "/compare HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: " +
                  std::to_string(body.size()) + "\r\n\r\n" + body.substr(0, 5));
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  connection.send(body.substr(5));
  EXPECT_EQ(connection.status(), "201");
}

TEST_F(StudioBounds, EndsHeadsThatTakeTooLong) {
  stop();
  start(0.3);
  EXPECT_EQ(status_of(kHealth), "408");
  EXPECT_EQ(status_of(std::string(kHealth) + "\r\n"), "200");
  const RawConnection slow(server_->port());
  slow.send(kHealth);
  int sent = 0;
  while (sent < 500 && !slow.is_answered(10)) {
    slow.send("x");
    ++sent;
  }
  EXPECT_LT(sent, 500) << "though bytes go on to come";
  EXPECT_EQ(slow.status(), "408");
}

TEST_F(StudioBounds, StopsWithoutWaitingForIdleClients) {
  const RawConnection silent(server_->port()), half(server_->port());
  half.send(kHealth);
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  const auto begin = std::chrono::steady_clock::now();
  stop();
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(3));
}

}  // namespace

}  // namespace anigen::studio
