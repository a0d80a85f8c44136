#include "anigen/studio/server.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <httplib.h>
#include <sys/socket.h>
#include <unistd.h>
#include <atomic>
#include <cctype>
#include <chrono>
#include <filesystem>
#include <memory>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "anigen/core/files.h"
#include "anigen/creatures/body.h"
#include "anigen/engine/files.h"
#include "anigen/studio/access.h"
#include "anigen/studio/job_process.h"
#include "anigen/studio/job_work.h"
#include "tests/support/hinged_boxes.h"
#include "tests/support/paths.h"

namespace anigen::studio {

namespace {

namespace fs = std::filesystem;

std::string dog_glb() {
  static const std::string bytes = [] {
    Asset dog = creatures::make_creature("quadruped", 3, 0);
    dog.skeleton = {};
    dog.skin = {};
    dog.animations.clear();
    return engine::save_bytes(dog);
  }();
  return bytes;
}

/// A studio on a free port, as the program has it.
class StudioServer : public ::testing::Test {
 protected:
  void start(std::size_t most_queued = 64, std::size_t most_bytes = std::size_t{16} << 20) {
    store_ = std::make_unique<JobStore>(folder_.path());
    runner_ = std::make_unique<JobRunner>(
        *store_, [this](const fs::path& place, Job& job, JobRecord& record) { work_.run(place, job, record); },
        most_queued);
    api_ = std::make_unique<Api>(*store_, *runner_);
    ServerOptions options;
    options.most_bytes = most_bytes;
    options.token = token_;
    options.page = test::source_dir() / "anigen/studio/page";
    options.openapi = find_openapi(options.page);
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

  httplib::Client client() const {
    httplib::Client client("127.0.0.1", server_->port());
    client.set_read_timeout(60);
    return client;
  }

  httplib::Result upload(const std::string& bytes, const std::string& name, const std::string& options = "",
                         const std::string& kind = "rig") const {
    httplib::MultipartFormDataItems items{{"file", bytes, name, "application/octet-stream"}};
    if (!options.empty()) items.push_back({"options", options, "", ""});
    return client().Post("/v1/3d/" + kind + "s", items);
  }

  /// Id of the job that a form of fields and files makes.
  std::string made(const std::string& kind, const httplib::MultipartFormDataItems& form) const {
    const httplib::Result result = client().Post("/v1/3d/" + kind + "s", form);
    EXPECT_EQ(result->status, 201) << result->body;
    return Json::parse(result->body).value("id", "");
  }

  std::string accepted(const std::string& bytes, const std::string& name, const std::string& options = "") const {
    const httplib::Result result = upload(bytes, name, options);
    EXPECT_TRUE(result);
    if (!result) return "";
    EXPECT_EQ(result->status, 201) << result->body;
    return Json::parse(result->body).value("id", "");
  }

  Json job(const std::string& id) const { return Json::parse(client().Get("/v1/jobs/" + id)->body); }

  /// The job once it has ended.
  Json ended(const std::string& id) const {
    for (int i = 0; i < 6000; ++i) {
      Json now = job(id);
      const std::string state = now.at("state");
      if (state != "queued" && state != "running") return now;
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    ADD_FAILURE() << id << " does not end";
    return {};
  }

  /// Status and error of a request that is refused.
  void refuses(const httplib::Result& result, int status, const std::string& words) const {
    ASSERT_TRUE(result) << words;
    EXPECT_EQ(result->status, status) << result->body;
    const Json body = Json::parse(result->body, nullptr, false);
    ASSERT_TRUE(body.is_object() && body.contains("error")) << result->body;
    EXPECT_NE(body["error"].get<std::string>().find(words), std::string::npos) << result->body;
  }

  /// Sends bytes as they are, and returns all that comes back. @param cut close our side after sending
  std::string raw(const std::string& request, bool cut = false) const {
    const int socket = ::socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(server_->port()));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(::connect(socket, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
    EXPECT_EQ(::send(socket, request.data(), request.size(), MSG_NOSIGNAL), static_cast<ssize_t>(request.size()));
    if (cut) ::shutdown(socket, SHUT_WR);
    std::string answer;
    char piece[4096];
    for (ssize_t got = 0; (got = ::recv(socket, piece, sizeof piece, 0)) > 0;)
      answer.append(piece, static_cast<std::size_t>(got));
    ::close(socket);
    return answer;
  }

  std::size_t jobs() const { return Json::parse(client().Get("/v1/jobs")->body).at("jobs").size(); }

  test::TemporaryFolder folder_;
  std::string token_;
  JobProcesses work_{{{ANIGEN_STUDIO_PROGRAM, "--worker"}}};
  std::unique_ptr<JobStore> store_;
  std::unique_ptr<JobRunner> runner_;
  std::unique_ptr<Api> api_;
  std::unique_ptr<Server> server_;
};

constexpr const char* kCurve = R"({"method": "curve", "joints": 12, "motions": ["idle"]})";

TEST_F(StudioServer, RigsAnUploadThatIsDownloadedInThreeFormats) {
  const std::string id = accepted(dog_glb(), "C:\\pets\\dog.glb", kCurve);
  const Json done = ended(id);
  ASSERT_EQ(done.at("state"), "done") << done.dump();
  EXPECT_EQ(done.at("name"), "dog.glb");
  EXPECT_EQ(done.at("result").at("joints"), 12);
  EXPECT_EQ(done.at("result").at("clips"), Json::array({"idle"}));
  httplib::Client reader = client();
  for (const std::string format : {"glb", "fbx", "usdz"}) {
    const httplib::Result file = reader.Get("/v1/jobs/" + id + "/files/rigged." + format);
    ASSERT_EQ(file->status, 200) << file->body;
    EXPECT_NE(file->get_header_value("Content-Disposition").find("dog." + format), std::string::npos);
    if (format == "usdz") continue;
    EXPECT_EQ(engine::load_bytes(file->body, "dog." + format).skeleton.size(), 12U) << format;
  }
  EXPECT_EQ(reader.Get("/v1/jobs/" + id + "/files/preview.png")->body.substr(1, 3), "PNG");
  EXPECT_EQ(reader.Get("/v1/jobs/" + id + "/files/input")->body, dog_glb());
  refuses(reader.Get("/v1/jobs/" + id + "/files/edited.glb"), 404, "no edited.glb");
  EXPECT_EQ(reader.Delete("/v1/jobs/" + id)->status, 200);
  refuses(reader.Get("/v1/jobs/" + id), 404, "no such job");
}

TEST_F(StudioServer, KeepsTheClipsOfAFileAndAddsOthers) {
  Asset dog = creatures::make_creature("quadruped", 3, 0);
  ASSERT_FALSE(dog.animations.empty());
  dog.animations.resize(1);
  dog.animations[0].name = "walk";
  const Json done = ended(accepted(engine::save_bytes(dog), "dog.glb", R"({"motions": ["walk", "idle"]})"));
  ASSERT_EQ(done.at("state"), "done") << done.dump();
  EXPECT_EQ(done.at("result").at("clips"), (Json::array({"walk", "idle"})));
}

TEST_F(StudioServer, BindsEditedJoints) {
  const std::string id =
      accepted(engine::save_bytes(test::hinged_boxes(0.1F, 0.2F)), "hinge.glb", R"({"motions": []})");
  ASSERT_EQ(ended(id).at("state"), "done");
  // Joints in glTF's frame, children before their parent.
  const std::string joints =
      R"([{"name": "tip", "parent": 1, "position": [0.9, 0, 0]}, {"name": "lid", "parent": 2, "position": [0.1, 0.25, 0]},
          {"name": "base", "parent": -1, "position": [-0.5, 0, 0]}])";
  httplib::Client sender = client();
  const std::string path = "/v1/jobs/" + id + "/rebind";
  for (const std::string method : {"heat", "geovoxel"}) {
    const httplib::Result result =
        sender.Post(path, "{\"method\": \"" + method + "\", \"joints\": " + joints + "}", "application/json");
    ASSERT_EQ(result->status, 200) << result->body;
    EXPECT_GT(std::stod(result->get_header_value("X-Bind-Milliseconds")), 0.0);
    const Asset bound = engine::load_bytes(result->body, "bound.glb");
    EXPECT_EQ(bound.skeleton.names, (std::vector<std::string>{"base", "lid", "tip"}));
    EXPECT_LT((bound.skeleton.positions()[1] - Eigen::Vector3d(0.1, 0, 0.25)).norm(), 1e-6);
    EXPECT_EQ(sender.Get("/v1/jobs/" + id + "/files/edited.glb")->body, result->body);
  }
  const httplib::Result draft =
      sender.Post(path, "{\"draft\": true, \"method\": \"nearest\", \"joints\": " + joints + "}", "application/json");
  EXPECT_EQ(engine::load_bytes(draft->body, "draft.glb").skeleton.size(), 3U);
  EXPECT_NE(sender.Get("/v1/jobs/" + id + "/files/edited.glb")->body, draft->body) << "a draft was kept";
  EXPECT_TRUE(job(id).at("edited"));
  EXPECT_EQ(sender.Get("/v1/jobs/" + id + "/files/edited.fbx")->status, 200);
  EXPECT_EQ(Json::parse(sender.Post("/v1/jobs/" + id + "/lint")->body).at("file"), "edited.glb");
  // Painted on what was bound, and on the weights of the rig.
  const std::string brush =
      R"(, "strokes": [{"joint": "tip", "center": [1.05, 0.5, 0.5], "radius": 0.5}, {"center": [0, 0, 0], "radius": 2,
          "mode": "smooth", "strength": 0.5}]})";
  const httplib::Result painted =
      sender.Post(path, R"({"method": "nearest", "joints": )" + joints + brush, "application/json");
  ASSERT_EQ(painted->status, 200) << painted->body;
  EXPECT_NE(painted->body, draft->body);
  const std::string own = R"([{"name": "base", "parent": -1, "position": [-0.5, 0, 0]},
      {"name": "lid", "parent": 0, "position": [0, 0, 0]}, {"name": "end", "parent": 1, "position": [1, 0, 0]}])";
  const httplib::Result kept = sender.Post(path, R"({"method": "keep", "joints": )" + own + "}", "application/json");
  ASSERT_EQ(kept->status, 200) << kept->body;
  const Asset rig = engine::load_bytes(sender.Get("/v1/jobs/" + id + "/files/rigged.glb")->body, "rigged.glb");
  EXPECT_EQ(to_dense(engine::load_bytes(kept->body, "kept.glb").skin, 3), to_dense(rig.skin, 3));
  refuses(sender.Post(path, R"({"method": "keep", "joints": )" + joints + "}", "application/json"), 400,
          "\"tip\" is no joint");
  refuses(sender.Post(path, R"({"joints": )" + own + brush, "application/json"), 400, "/0/joint");
  refuses(sender.Post(path,
                      R"({"joints": )" + own + R"(, "strokes": [{"joint": "lid", "center": [0, 0, 0], "radius": -1}]})",
                      "application/json"),
          400, "radius");
  const httplib::Result renamed =
      sender.Post("/v1/jobs/" + id + "/rename", R"({"names": "chain"})", "application/json");
  ASSERT_EQ(renamed->status, 200) << renamed->body;
  EXPECT_EQ(sender.Get("/v1/jobs/" + id + "/files/edited.glb")->body, renamed->body);
  const std::vector<std::string> names = engine::load_bytes(renamed->body, "renamed.glb").skeleton.names;
  EXPECT_EQ(names.front().rfind("chain_", 0), 0U);
  refuses(sender.Post("/v1/jobs/" + id + "/rename", R"({"names": "vrm"})", "application/json"), 409, "--names");
  refuses(sender.Post("/v1/jobs/" + id + "/rename", R"({"names": "xsi"})", "application/json"), 400, "names");
  refuses(sender.Get("/v1/jobs/" + id + "/files/edited.vrm"), 409, "VRM");
  const httplib::Result archive = sender.Get("/v1/jobs/" + id + "/files/edited.zip");
  EXPECT_EQ(archive->status, 200);
  EXPECT_EQ(archive->body.substr(0, 2), "PK");
  const auto refused = [&](const std::string& list, const std::string& words) {
    refuses(sender.Post(path, "{\"joints\": " + list + "}", "application/json"), 400, words);
  };
  refused("[]", "no list of joints");
  refused(R"([{"name": "a", "parent": 1, "position": [0,0,0]}, {"name": "b", "parent": 0, "position": [0,0,0]}])",
          "cycle");
  refused(R"([{"name": "a", "parent": -1, "position": [0,0,0]}, {"name": "a", "parent": 0, "position": [0,0,0]}])",
          "twice");
  refused(R"([{"name": "a", "parent": -1, "position": [0,0,0]}, {"name": "b", "parent": -1, "position": [0,0,0]}])",
          "2 roots");
  refused(R"([{"name": "a", "parent": -1, "position": [0,1e300,0]}])", "/0/position");
  refused(R"([{"name": "a", "parent": -1, "position": [0,0]}])", "/0/position");
  refuses(sender.Post(path, "{\"joints\": [", "application/json"), 400, "request");
  refuses(sender.Post(path, std::string(2000, '['), "application/json"), 400, "request");
}

TEST_F(StudioServer, ComparesMethodsAndEvaluatesAgainstATruth) {
  const Asset truth = test::hinged_boxes(0.1F, 0.2F);
  const std::string id = accepted(engine::save_bytes(truth), "hinge.glb", R"({"motions": []})");
  ASSERT_EQ(ended(id).at("state"), "done");
  httplib::Client sender = client();
  const httplib::Result compared =
      sender.Post("/v1/jobs/" + id + "/compare", R"({"methods": ["heat", "nearest"]})", "application/json");
  ASSERT_EQ(compared->status, 201) << compared->body;
  for (const Json& other : Json(Json::parse(compared->body).at("jobs"))) {
    EXPECT_EQ(other.at("group"), id);
    EXPECT_EQ(ended(other.at("id")).at("state"), "done");
  }
  refuses(sender.Post("/v1/jobs/" + id + "/compare", R"({"methods": ["magic"]})", "application/json"), 400, "magic");
  const httplib::MultipartFormData of{"job", id, "", ""},
      rig{"file", engine::save_bytes(truth), "a.glb", "model/gltf-binary"},
      expected{"truth", engine::save_bytes(truth), "truth.glb", "model/gltf-binary"};
  for (const httplib::MultipartFormData& prediction : {of, rig}) {
    const Json scores = ended(made("evaluation", {prediction, expected}));
    ASSERT_EQ(scores.at("state"), "done") << scores.dump();
    EXPECT_NEAR(scores.at("scores").at("values").at("j2j").get<double>(), 0.0, 1e-6);
    EXPECT_TRUE(scores.at("scores").at("not_computed").is_object());
    refuses(sender.Get("/v1/jobs/" + scores.value("id", "") + "/files/rigged.glb"), 404, "no rigged.glb");
    refuses(sender.Post("/v1/jobs/" + scores.value("id", "") + "/lint"), 409, "an evaluation");
  }
  const std::string path = "/v1/3d/evaluations";
  refuses(sender.Post(path, httplib::MultipartFormDataItems{of}), 400, "truth");
  refuses(sender.Post(path, httplib::MultipartFormDataItems{expected}), 400, "file");
  refuses(sender.Post(path, httplib::MultipartFormDataItems{{"job", "j9", "", ""}, expected}), 404, "no such job");
  refuses(sender.Post(path, httplib::MultipartFormDataItems{of, expected, {"options", R"({"group": []})", "", ""}}),
          400, "did you mean");
  const Json wrong = ended(made("evaluation", {of, expected, {"options", R"({"groups": ["looks"]})", "", ""}}));
  EXPECT_EQ(wrong.at("state"), "failed");
  EXPECT_NE(wrong.value("error", "").find("looks"), std::string::npos) << wrong.dump();
}

/// A motion in which the joint "a" of a chain of two turns about Y.
std::string bvh_text() {
  return "HIERARCHY\nROOT base\n{\nOFFSET 0 0 0\nCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation "
         "Yrotation\nJOINT a\n{\nOFFSET 0 1 0\nCHANNELS 3 Zrotation Xrotation Yrotation\nEnd Site\n{\nOFFSET 0 1 "
         "0\n}\n}\n}\nMOTION\nFrames: 2\nFrame Time: 0.5\n0 0 0 0 0 0 0 0 0\n0 0 0 0 0 0 30 0 0\n";
}

TEST_F(StudioServer, AddsMotionsToARig) {
  const std::string dog = engine::save_bytes(creatures::make_creature("quadruped", 3, 0));
  const std::string id = accepted(dog, "dog.glb", R"({"motions": ["idle"]})");
  const Json first = ended(id);
  ASSERT_EQ(first.at("state"), "done") << first.dump();
  const httplib::MultipartFormData of{"job", id, "", ""}, motion{"motion", bvh_text(), "C:\\my\\nod.bvh", ""};
  const Json moved = ended(made("animation", {of, motion}));
  ASSERT_EQ(moved.at("state"), "done") << moved.dump();
  Json clips = first.at("result").at("clips");
  clips.push_back("nod");
  EXPECT_EQ(moved.at("result").at("clips"), clips);
  EXPECT_EQ(moved.at("source"), id);
  const Json again = ended(made(
      "animation",
      {{"job", moved.value("id", ""), "", ""}, motion, {"options", R"({"motions": ["walk"], "fps": 12})", "", ""}}));
  ASSERT_EQ(again.at("state"), "done") << again.dump();
  for (const char* more : {"nod_2", "walk"}) clips.push_back(more);
  EXPECT_EQ(again.at("result").at("clips"), clips);
  EXPECT_EQ(ended(made("animation", {{"file", dog, "dog.glb", ""}})).at("state"), "done");
  const Json bare = ended(made("animation", {{"file", dog_glb(), "dog.glb", ""}}));
  EXPECT_NE(bare.value("error", "").find("no joints"), std::string::npos) << bare.dump();
  const auto refused = [&](const httplib::MultipartFormDataItems& form, const std::string& words) {
    refuses(client().Post("/v1/3d/animations", form), 400, words);
  };
  refused({of, {"motion", "x", "dance.txt", ""}}, "is not a motion");
  refused({{"file", "x", "a.obj", ""}}, "is not a rigged asset");
  refused({of, {"options", R"({"fps": 0})", "", ""}}, "fps");
}

TEST_F(StudioServer, KeepsAnUploadedMotionInEdits) {
  Asset dog = creatures::make_creature("quadruped", 3, 0);
  dog.animations.clear();
  const std::string id =
      made("animation", {{"file", engine::save_bytes(dog), "dog.glb", ""}, {"motion", bvh_text(), "nod.bvh", ""}});
  const Json done = ended(id);
  ASSERT_EQ(done.at("state"), "done") << done.dump();
  EXPECT_EQ(done.at("result").at("clips"), Json::array({"nod"}));
  const auto edited = [&](const std::string& action, const Json& request) {
    const httplib::Result result = client().Post("/v1/jobs/" + id + "/" + action, request.dump(), "application/json");
    EXPECT_EQ(result->status, 200) << result->body;
    std::vector<std::string> clips;
    for (const Animation& clip : engine::load_bytes(result->body, "edited.glb").animations) clips.push_back(clip.name);
    return clips;
  };
  const std::vector<std::string> nod{"nod"};
  EXPECT_EQ(edited("rename", {{"names", "chain"}}), nod);
  Json joints = Json::array();
  const std::vector<Eigen::Vector3d> places = dog.skeleton.positions();
  for (std::size_t j = 0; j < places.size(); ++j) {
    joints.push_back({{"name", dog.skeleton.names[j]},
                      {"parent", dog.skeleton.parents[j]},
                      {"position", {places[j].x(), places[j].z(), -places[j].y()}}});
  }
  for (const char* method : {"heat", "nearest"})
    EXPECT_EQ(edited("rebind", {{"method", method}, {"joints", joints}}), nod) << method;
  EXPECT_EQ(edited("rename", {{"names", "chain"}}), nod);
}

TEST_F(StudioServer, SendsTheEventsOfAJob) {
  const std::string id = accepted(dog_glb(), "dog.glb", kCurve);
  std::string text;
  const httplib::Result result = client().Get("/v1/jobs/" + id + "/events", [&](const char* data, std::size_t size) {
    text.append(data, size);
    return true;
  });
  ASSERT_TRUE(result);
  EXPECT_EQ(result->get_header_value("Content-Type"), "text/event-stream");
  std::vector<Json> jobs;
  for (std::size_t begin = 0; (begin = text.find("data: ", begin)) != std::string::npos; ++begin) {
    EXPECT_EQ(text.substr(begin - 11, 11), "event: job\n");
    jobs.push_back(Json::parse(text.substr(begin + 6, text.find("\n\n", begin) - begin - 6)));
  }
  ASSERT_GE(jobs.size(), 1U);
  EXPECT_EQ(jobs.back().at("state"), "done") << "the stream ends when the job has";
  for (std::size_t i = 1; i < jobs.size(); ++i) EXPECT_NE(jobs[i], jobs[i - 1]);
  EXPECT_EQ(jobs.back(), job(id));
  refuses(client().Get("/v1/jobs/j777/events"), 404, "no such job");
}

TEST_F(StudioServer, DescribesEachOfItsRoutes) {
  const httplib::Result answer = client().Get("/openapi.json");
  ASSERT_EQ(answer->status, 200);
  const Json description = Json::parse(answer->body);
  std::set<std::pair<std::string, std::string>> described, served;
  for (const auto& [path, methods] : description.at("paths").items()) {
    for (const auto& [method, what] : methods.items()) {
      std::string upper = method;
      for (char& c : upper) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
      described.emplace(upper, path);
      EXPECT_TRUE(what.contains("summary") && what.contains("responses")) << path;
    }
  }
  for (const auto& route : server_->routes()) served.insert(route);
  EXPECT_EQ(described, served);
}

TEST_F(StudioServer, CancelsAJob) {
  const std::string first = accepted(dog_glb(), "dog.glb", kCurve), second = accepted(dog_glb(), "dog.glb", kCurve);
  const httplib::Result cancelled = client().Delete("/v1/jobs/" + second);
  EXPECT_EQ(cancelled->status, 202) << cancelled->body;
  EXPECT_EQ(ended(second).at("state"), "cancelled");
  EXPECT_EQ(ended(first).at("state"), "done");
  refuses(client().Get("/v1/jobs/" + second + "/files/rigged.glb"), 404, "no rigged.glb");
  refuses(client().Post("/v1/jobs/" + second + "/lint"), 409, "cancelled");
}

TEST_F(StudioServer, RefusesUploadsThatAreNoJobs) {
  refuses(upload("abc", "notes.txt"), 400, "is not a mesh");
  refuses(upload("abc", "a.obj", "", "generation"), 400, "is not an image");
  refuses(upload("abc", ""), 400, "name");
  refuses(upload("", "a.glb"), 400, "empty");
  refuses(upload("abc", "a.obj", "{\"method\": "), 400, "request");
  refuses(upload("abc", "a.obj", R"({"method": "magic"})"), 400, "method");
  refuses(upload("abc", "a.obj", R"({"metod": "heat"})"), 400, "did you mean");
  refuses(upload("abc", "a.obj", R"({"motions": ["/etc/passwd"]})"), 400, "no built-in motion");
  refuses(upload("abc", "a.png", R"({"seed": -4})", "generation"), 400, "seed");
  refuses(client().Post("/v1/3d/rigs", "{}", "application/json"), 415, "multipart");
  EXPECT_EQ(jobs(), 0U);
  // A file that looks like a mesh becomes a job that fails with a reason.
  const std::string id = accepted("v 0 0 nan\n", "../../etc/bad.obj");
  const Json failed = ended(id);
  EXPECT_EQ(failed.at("state"), "failed");
  EXPECT_EQ(failed.at("name"), "bad.obj");
  EXPECT_NE(failed.at("error").get<std::string>().find("input.obj"), std::string::npos) << failed.dump();
  EXPECT_EQ(ended(accepted(dog_glb().substr(0, 500), "cut.glb")).at("state"), "failed");
}

TEST_F(StudioServer, RefusesPathsThatLeadOutside) {
  httplib::Client reader = client();
  const std::string id = accepted("x", "a.obj");
  const std::string files = "/v1/jobs/" + id + "/files/";
  const std::vector<std::string> paths{"/v1/jobs/../../etc/passwd",
                                       "/v1/jobs/..%2f..%2fetc",
                                       "/v1/jobs/j000001%00",
                                       files + "..",
                                       files + "job.json",
                                       files + "..%2fjob.json",
                                       "/../server.cpp",
                                       "/..%2fserver.cpp",
                                       "/gallery/..%2f..%2fREADME.md",
                                       "/studio.js/"};
  for (const std::string& path : paths) refuses(reader.Get(path), 404, "");
  const std::string long_path(6000, 'a');
  refuses(reader.Get("/v1/jobs/" + long_path), 404, "no such job");
}

TEST_F(StudioServer, RefusesForeignPages) {
  const std::string host = "127.0.0.1:" + std::to_string(server_->port());
  const auto status = [&](const std::string& headers) {
    return raw("GET /v1/jobs HTTP/1.1\r\n" + headers + "\r\n").substr(9, 3);
  };
  EXPECT_EQ(status("Host: " + host + "\r\n"), "200");
  EXPECT_EQ(status("Host: LOCALHOST:99\r\n"), "200");
  EXPECT_EQ(status("Host: " + host + "\r\nOrigin: http://" + host + "\r\n"), "200");
  EXPECT_EQ(status("Host: " + host + "\r\nOrigin: https://example.org\r\n"), "403");
  EXPECT_EQ(status("Host: " + host + "\r\nOrigin: null\r\n"), "403");
  EXPECT_EQ(status("Host: example.org\r\n"), "403");
  EXPECT_EQ(status("Host: 127.0.0.1.example.org\r\n"), "403");
  EXPECT_EQ(status(""), "403");
  Access open;
  open.loopback_only = false;
  EXPECT_EQ(open.refusal("studio.lan:8080", ""), "");
  EXPECT_EQ(open.refusal("studio.lan:8080", "http://studio.lan:8080"), "");
  EXPECT_NE(open.refusal("studio.lan:8080", "http://example.org"), "");
}

TEST_F(StudioServer, AsksForItsTokenWhereItHasOne) {
  stop();
  token_ = new_token();
  EXPECT_EQ(token_.size(), 32U);
  EXPECT_NE(token_, new_token());
  start();
  EXPECT_NE(server_->address().find("/?token=" + token_), std::string::npos);
  httplib::Client asker = client();
  refuses(asker.Get("/v1/jobs"), 401, "token");
  refuses(asker.Get("/?token=wrong"), 401, "token");
  refuses(asker.Get("/v1/jobs", {{"Cookie", "anigen_token=" + token_.substr(1)}}), 401, "token");
  EXPECT_EQ(asker.Get("/v1/jobs", {{"Authorization", "Bearer " + token_}})->status, 200);
  const httplib::Result entered = asker.Get("/?token=" + token_);
  EXPECT_EQ(entered->status, 303);
  const std::string cookie = entered->get_header_value("Set-Cookie");
  EXPECT_NE(cookie.find("SameSite=Strict"), std::string::npos);
  EXPECT_EQ(asker.Get("/", {{"Cookie", "a=b; " + cookie.substr(0, cookie.find(';'))}})->status, 200);
}

TEST_F(StudioServer, CountsJobsByState) {
  ended(accepted("x", "a.obj"));
  EXPECT_NE(client().Get("/metrics")->body.find("anigen_jobs{state=\"failed\"} 1\n"), std::string::npos);
  EXPECT_EQ(client().Get("/health")->status, 200);
  EXPECT_EQ(client().Get("/ready")->status, 200);
}

TEST_F(StudioServer, RefusesBodiesOfHostileSizes) {
  const std::string head =
      "POST /v1/3d/rigs HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: multipart/form-data; boundary=b\r\n";
  const auto status = [&](const std::string& rest) { return raw(head + rest).substr(9, 3); };
  EXPECT_EQ(status("Content-Length: 2147483648\r\n\r\n"), "413");
  EXPECT_EQ(status("Content-Length: 99999999999999999999999\r\n\r\n"), "413");
  EXPECT_EQ(status("Content-Length: -5\r\n\r\n"), "400");
  EXPECT_EQ(status("Transfer-Encoding: chunked\r\n\r\n5\r\nabcde\r\n0\r\n\r\n"), "411");
  EXPECT_EQ(status("Content-Encoding: gzip\r\nContent-Length: 3\r\n\r\nabc"), "415");
  EXPECT_EQ(status("Content-Length: 5\r\n\r\nabcde"), "400");
  // Nobody is there to hear the answer to an upload that was cut off.
  raw(head +
          "Content-Length: 5000\r\n\r\n--b\r\nContent-Disposition: form-data; name=\"file\"; "
          "filename=\"a.obj\"\r\n\r\nv 0",
      true);
  EXPECT_EQ(jobs(), 0U);
  raw("\r\n\r\n\r\n", true);
  raw(std::string(20'000, 'x') + "\r\n\r\n", true);
  EXPECT_EQ(client().Get("/v1/jobs")->status, 200);
}

TEST_F(StudioServer, AnswersManyClientsAndKeepsTheirJobs) {
  std::atomic<int> failed{0};
  std::vector<std::thread> clients;
  for (int c = 0; c < 4; ++c) {
    clients.emplace_back([&, c] {
      for (int i = 0; i < 5; ++i) {
        const bool hostile = i == c;
        const std::string bytes = hostile ? dog_glb().substr(0, 700) : dog_glb();
        const httplib::Result result = upload(bytes, "dog" + std::to_string(10 * c + i) + ".glb",
                                              R"({"method": "pinocchio", "templates": ["fox"], "motions": []})");
        if (!result || result->status != 201) ++failed;
      }
    });
  }
  for (std::thread& thread : clients) thread.join();
  EXPECT_EQ(failed, 0);
  const Json all = Json::parse(client().Get("/v1/jobs")->body).at("jobs");
  ASSERT_EQ(all.size(), 20U);
  // Killed in the middle, as far as the disk is concerned, and started again: no job is lost.
  stop();
  start();
  std::size_t done = 0, reasons = 0;
  for (const Json& one : all) {
    const Json last = ended(one.at("id"));
    if (last.at("state") == "done") ++done;
    if (last.at("state") == "failed" && !last.at("error").get<std::string>().empty()) ++reasons;
  }
  EXPECT_EQ(done, 16U);
  EXPECT_EQ(reasons, 4U);
}

TEST_F(StudioServer, SaysWhenTooManyJobsWait) {
  stop();
  start(1);
  int refused = 0;
  for (int i = 0; i < 6; ++i) {
    const httplib::Result result = upload(dog_glb(), "dog.glb", kCurve);
    if (result->status == 429) ++refused;
    if (result->status == 429) refuses(result, 429, "too many jobs");
  }
  EXPECT_GE(refused, 1);
  runner_->stop();
  refuses(client().Get("/ready"), 503, "stopping");
}

}  // namespace

}  // namespace anigen::studio
