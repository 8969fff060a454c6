#include "palpate/viewer/server.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>

#include "palpate/common/error.h"
#include "running_server.h"
#include "shared/web_client.h"

namespace palpate {
namespace {

using test::ask;
using test::bytesOf;
using test::fieldOf;
using test::readAnswer;
using test::RunningServer;
using test::sampleBatch;
using test::SocketClient;
using test::TcpClient;
using Clock = std::chrono::steady_clock;

double secondsSince(Clock::time_point begin) { return std::chrono::duration<double>(Clock::now() - begin).count(); }

ServerOptions withToken(const std::string& token) {
  ServerOptions options;
  options.token = token;
  return options;
}

std::string errorOf(const ServerOptions& options) {
  try {
    Server server(options, {}, "{}", {});
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

// --- binding

TEST(Server, TellsWhereItListens) {
  RunningServer running;
  EXPECT_EQ(running.server.url(), "http://127.0.0.1:" + std::to_string(running.server.port()) + "/");
  RunningServer guarded(withToken("T"));
  EXPECT_EQ(guarded.server.url(), "http://127.0.0.1:" + std::to_string(guarded.server.port()) + "/?token=T");
}

TEST(Server, ListensOnVersionSixAddresses) {
  ServerOptions options;
  options.address = "::1";
  std::unique_ptr<Server> server;
  try {
    server = std::make_unique<Server>(options, std::vector<StaticFile>{}, "{}", ServerHandlers{});
  } catch (const InputError&) {
    GTEST_SKIP() << "no IPv6 here";
  }
  EXPECT_EQ(server->url(), "http://[::1]:" + std::to_string(server->port()) + "/");
}

TEST(Server, RefusesWhatItCannotListenOn) {
  RunningServer running;
  ServerOptions options;
  options.port = running.server.port();
  EXPECT_EQ(errorOf(options),
            "--port: " + std::to_string(options.port) + " is in use on 127.0.0.1; 0 takes any free one");
  options = {};
  options.address = "localhost";
  EXPECT_EQ(errorOf(options), "--listen: 'localhost' is not a numeric address such as 192.168.1.7 or ::1");
  options.address = "0.0.0.0";
  EXPECT_EQ(errorOf(options), "--listen: 0.0.0.0 can be reached from other machines, so it needs --token");
  options.address = "192.0.2.1";  // reserved for documentation
  options.token = "T";
  EXPECT_EQ(errorOf(options), "--listen: 192.0.2.1 is not an address of this machine");
  EXPECT_EQ(errorOf(withToken("a b")),
            "--token: takes letters, digits and the characters - . _ ~, at most 128 of them");
}

// --- HTTP

TEST(Server, ServesThePage) {
  RunningServer running;
  const unsigned short port = running.server.port();
  const auto page = ask(port, "GET", "/?x=1");
  EXPECT_EQ(page.status, 200);
  EXPECT_EQ(page.body, "<p>page");
  EXPECT_EQ(page.headers.at("content-type"), "text/html; charset=utf-8");
  EXPECT_EQ(page.headers.at("x-content-type-options"), "nosniff");
  EXPECT_EQ(page.headers.at("content-security-policy").substr(0, 39), "default-src 'none'; script-src 'self'; ");
  EXPECT_EQ(page.headers.count("set-cookie"), 0u);
  EXPECT_EQ(ask(port, "GET", "/app.js").body, "1;");
  EXPECT_EQ(ask(port, "GET", "/session.json").body, R"({"mode":"view"})");
  const auto head = ask(port, "HEAD", "/app.js");
  EXPECT_EQ(head.status, 200);
  EXPECT_EQ(head.headers.at("content-length"), "2");
  EXPECT_EQ(ask(port, "GET", "/missing").status, 404);
  EXPECT_EQ(ask(port, "GET", "/../etc/passwd").status, 404);
  EXPECT_EQ(ask(port, "DELETE", "/").status, 405);
  EXPECT_EQ(ask(port, "DELETE", "/").headers.at("allow"), "GET, HEAD");
  EXPECT_EQ(ask(port, "GET", "/surface").status, 405);
  EXPECT_EQ(ask(port, "GET", "/ws").status, 426);
}

TEST(Server, AnswersRequestsThatComeTogetherInOrder) {
  RunningServer running;
  TcpClient client(running.server.port());
  const std::string host = " HTTP/1.1\r\nHost: localhost\r\n\r\n";
  client.send("GET /app.js" + host + "HEAD /" + host + "GET /x" + host + "GET /" + host);
  EXPECT_EQ(readAnswer(client).body, "1;");
  EXPECT_EQ(readAnswer(client, true).headers.at("content-length"), "7");
  EXPECT_EQ(readAnswer(client).status, 404);
  EXPECT_EQ(readAnswer(client).body, "<p>page");
  client.send("GET / HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
  EXPECT_EQ(readAnswer(client).headers.at("connection"), "close");
  EXPECT_TRUE(client.endsNow());
}

TEST(Server, AnswersGarbageAndCloses) {
  RunningServer running;
  for (const std::string& garbage :
       {std::string("\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03 TLS"), std::string("hello\r\n\r\n"),
        std::string(100'000, 'A'), std::string("GET / HTTP/1.1\r\nHost: localhost\r\nContent-Length: x\r\n\r\n")}) {
    TcpClient client(running.server.port());
    client.send(garbage);
    EXPECT_GE(readAnswer(client).status, 400);
    EXPECT_TRUE(client.endsNow());
  }
  TcpClient client(running.server.port());
  client.send("GET / HTTP/1.1\r\nHost: localhost\r\nX: " + std::string(40'000, 'a') + "\r\n\r\n");
  EXPECT_EQ(readAnswer(client).status, 431);
  EXPECT_EQ(ask(running.server.port(), "GET", "http://localhost/").status, 400);
  // what comes with a request that has no use for it is no request
  TcpClient smuggler(running.server.port());
  smuggler.send(
      "GET / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 41\r\n\r\nGET /app.js HTTP/1.1\r\nHost: localhost\r\n\r\n");
  EXPECT_EQ(readAnswer(smuggler).body, "<p>page");
  EXPECT_TRUE(smuggler.endsNow());
  EXPECT_EQ(ask(running.server.port(), "GET", "/").status, 200);
}

TEST(Server, RefusesForeignHosts) {
  RunningServer running;
  const unsigned short port = running.server.port();
  EXPECT_EQ(ask(port, "GET", "/", "Host: evil.example\r\n").status, 403);
  EXPECT_EQ(ask(port, "GET", "/", "Host: localhost\r\nHost: evil.example\r\n").status, 403);
  EXPECT_EQ(ask(port, "GET", "/session.json", "Host: evil.example:" + std::to_string(port) + "\r\n").status, 403);
  EXPECT_EQ(SocketClient(port, "Host: evil.example\r\nOrigin: http://evil.example\r\n").answer.status, 403);
  TcpClient none(port);
  none.send("GET / HTTP/1.1\r\n\r\n");
  EXPECT_EQ(readAnswer(none).status, 403);
}

TEST(Server, RefusesForeignOrigins) {
  RunningServer running;
  const unsigned short port = running.server.port();
  EXPECT_EQ(SocketClient(port, "Origin: http://evil.example\r\n").answer.status, 403);
  EXPECT_EQ(SocketClient(port, "Origin: null\r\n").answer.status, 403);
  for (const char* headers :
       {"Origin: http://evil.example\r\n", "Origin: null\r\n", "Referer: http://evil.example/\r\n",
        "Sec-Fetch-Site: cross-site\r\n", "User-Agent: Mozilla/5.0\r\n"})
    EXPECT_EQ(ask(port, "POST", "/surface?name=a.obj", headers, "v").status, 403) << headers;
  EXPECT_TRUE(running.surfaces.empty());
  const std::string own = "Origin: http://127.0.0.1:" + std::to_string(port) + "\r\nUser-Agent: Mozilla/5.0\r\n";
  EXPECT_EQ(ask(port, "POST", "/surface?name=a.obj", own, "v").status, 202);
  EXPECT_EQ(ask(port, "POST", "/surface?name=a.obj", "User-Agent: curl/8\r\n", "v").status, 202);
}

TEST(Server, AsksForTheToken) {
  RunningServer running(withToken("secret"));
  const unsigned short port = running.server.port();
  const std::string cookie = "palpate-" + std::to_string(port);
  for (const char* target :
       {"/", "/app.js", "/session.json", "/missing", "/?token=", "/?token=Secret", "/?token=secret1"})
    EXPECT_EQ(ask(port, "GET", target).status, 403) << target;
  EXPECT_EQ(ask(port, "GET", "/", "Cookie: " + cookie + "=wrong\r\n").status, 403);
  EXPECT_EQ(ask(port, "POST", "/surface?name=a.obj", "", "v").status, 403);
  EXPECT_EQ(SocketClient(port).answer.status, 403);

  const auto page = ask(port, "GET", "/?token=secret");
  EXPECT_EQ(page.status, 200);
  EXPECT_EQ(page.headers.at("set-cookie"), cookie + "=secret; Path=/; HttpOnly; SameSite=Strict");
  EXPECT_EQ(page.headers.at("referrer-policy"), "same-origin");
  const std::string with_cookie = "Cookie: other=1; " + cookie + "=secret\r\n";
  EXPECT_EQ(ask(port, "GET", "/app.js", with_cookie).status, 200);
  EXPECT_EQ(ask(port, "GET", "/app.js", with_cookie).headers.count("set-cookie"), 0u);
  EXPECT_TRUE(SocketClient(port, with_cookie).open());
  EXPECT_TRUE(SocketClient(port, "", "/ws?token=secret").open());
}

TEST(Server, TakesSurfaces) {
  RunningServer running;
  const unsigned short port = running.server.port();
  const auto taken = ask(port, "POST", "/surface?name=..%2Fmy%20bunny.obj", "", "v 0 0 0");
  EXPECT_EQ(taken.status, 202);
  EXPECT_EQ(taken.body, "{\"name\":\"my bunny.obj\"}\n");
  ASSERT_EQ(running.surfaces.size(), 1u);
  EXPECT_EQ(running.surfaces[0], std::make_pair(std::string("my bunny.obj"), std::string("v 0 0 0")));
  EXPECT_FALSE(running.placed);
  EXPECT_EQ(ask(port, "POST", "/surface?name=a.obj&place=1", "", "v").status, 202);
  EXPECT_TRUE(running.placed);
  EXPECT_EQ(ask(port, "POST", "/surface?name=a.obj&place=2", "", "v").status, 400);
  EXPECT_EQ(ask(port, "POST", "/surface?name=a.obj&place=yes", "", "v").status, 400);
  const auto bad = ask(port, "POST", "/surface?name=a.obj", "", "bad");
  EXPECT_EQ(bad.status, 400);
  EXPECT_EQ(bad.body, "{\"error\":\"line 1: no \\\"surface\\\"\"}\n");
  EXPECT_EQ(ask(port, "POST", "/surface", "", "v").status, 400);
  EXPECT_EQ(ask(port, "POST", "/surface?name=%0a", "", "v").status, 400);
  EXPECT_EQ(ask(port, "POST", "/surface?name=a.obj").status, 400);

  TcpClient patient(port);  // asks first, sends in chunks, and goes on with the connection
  patient.send(
      "POST /surface?name=a.obj HTTP/1.1\r\nHost: localhost\r\nExpect: 100-continue\r\nTransfer-Encoding: "
      "chunked\r\n\r\n");
  EXPECT_EQ(readAnswer(patient).status, 100);
  EXPECT_EQ(ask(port, "POST", "/surface?name=b.obj", "", "v").status, 503);  // one at a time
  patient.send("3\r\nv 1\r\n2\r\n 2\r\n0\r\n\r\n");
  EXPECT_EQ(readAnswer(patient).status, 202);
  EXPECT_EQ(running.surfaces.back().second, "v 1 2");
  patient.send("GET /app.js HTTP/1.1\r\nHost: localhost\r\n\r\n");
  EXPECT_EQ(readAnswer(patient).body, "1;");
}

TEST(Server, RefusesSurfacesThatAreTooLarge) {
  ServerOptions options;
  options.max_surface_bytes = 100'000;
  RunningServer running(options);
  const unsigned short port = running.server.port();
  EXPECT_EQ(ask(port, "POST", "/surface?name=a.obj", "", std::string(100'000, 'v')).status, 202);
  const auto large = ask(port, "POST", "/surface?name=a.obj", "", std::string(8'000'000, 'v'));
  EXPECT_EQ(large.status, 413);
  EXPECT_EQ(large.body, "{\"error\":\"the file is larger than 100000 bytes\"}\n");
  TcpClient chunked(port);
  chunked.send("POST /surface?name=a.obj HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n");
  for (int i = 0; i < 100; ++i) chunked.send("2000\r\n" + std::string(0x2000, 'v') + "\r\n");
  EXPECT_EQ(readAnswer(chunked).status, 413);
  EXPECT_EQ(running.surfaces.size(), 1u);
  EXPECT_EQ(ask(port, "POST", "/surface?name=a.obj", "", "v").status, 202);
}

TEST(Server, SendsFilesFromDisk) {
  const auto path = std::filesystem::path(testing::TempDir()) / "palpate-server-test.recording";
  std::string content;
  for (int i = 0; i < 300'000; ++i) content += std::to_string(i);
  std::ofstream(path, std::ios::binary) << content;
  {
    RunningServer running({}, path);
    const auto file = ask(running.server.port(), "GET", "/recording");
    EXPECT_EQ(file.status, 200);
    EXPECT_EQ(file.headers.at("content-length"), std::to_string(content.size()));
    EXPECT_TRUE(file.body == content);
    EXPECT_EQ(ask(running.server.port(), "HEAD", "/recording").headers.at("content-length"),
              std::to_string(content.size()));
    std::filesystem::remove(path);
    EXPECT_EQ(ask(running.server.port(), "GET", "/recording").status, 404);
  }
  Server server({}, {}, "{}", {});
  EXPECT_THROW(server.addFile(path, "/recording"), InputError);
}

TEST(Server, ClosesConnectionsThatSendNothing) {
  ServerOptions options;
  options.idle_timeout = 0.2;
  RunningServer running(options);
  const auto begin = Clock::now();
  TcpClient silent(running.server.port()), slow(running.server.port());
  slow.send("GET / HTTP/1.1\r\nHost: ");
  SocketClient asleep(running.server.port());  // does not answer pings
  EXPECT_TRUE(silent.endsNow());
  EXPECT_TRUE(slow.endsNow());
  EXPECT_TRUE(running.waitFor([&] { return running.left.size() == 1; }));
  EXPECT_GT(secondsSince(begin), 0.15);
  EXPECT_LT(secondsSince(begin), 5.0);
}

TEST(Server, KeepsViewersThatAnswerPings) {
  ServerOptions options;
  options.idle_timeout = 0.2;
  RunningServer running(options);
  SocketClient viewer(running.server.port());
  EXPECT_EQ(viewer.read().kind, 1);
  for (int i = 0; i < 5; ++i) {
    const auto ping = viewer.read(true);
    ASSERT_EQ(ping.kind, 9);
    viewer.sendFrame(10, ping.data);
  }
  EXPECT_EQ(running.server.viewers(), 1);
}

// --- viewers

TEST(Server, GreetsNewcomers) {
  ServerOptions options;
  options.version = "1.2";
  RunningServer running(options);
  Server& server = running.server;
  server.setGreeting({{false, bytesOf("scene 1")}, {true, bytesOf("geometry 1")}});
  server.setState(bytesOf("old state"));
  server.setState(bytesOf("state"));
  server.frame(4, bytesOf("full"), bytesOf("light"));
  const unsigned short port = server.port();
  SocketClient first(port);
  ASSERT_TRUE(first.open());
  EXPECT_EQ(first.answer.headers.count("sec-websocket-extensions"), 0u);
  EXPECT_EQ(first.answer.headers.at("sec-websocket-accept"), "s3pPLMBiTxaQ9kYGzzhZRbK+xOo=");
  EXPECT_EQ(first.read().data, R"({"type":"welcome","protocol":1,"viewer":1,"version":"1.2"})");
  EXPECT_EQ(first.read().data, "scene 1");
  const auto geometry = first.read();
  EXPECT_EQ(geometry.kind, 2);
  EXPECT_EQ(geometry.data, "geometry 1");
  EXPECT_EQ(first.read().data, "state");
  EXPECT_EQ(first.read().data, "full");
  SocketClient second(port);
  EXPECT_EQ(second.read().data, R"({"type":"welcome","protocol":1,"viewer":2,"version":"1.2"})");
  for (const char* expected : {"scene 1", "geometry 1", "state", "full"}) EXPECT_EQ(second.read().data, expected);

  ASSERT_TRUE(running.waitForViewers(2));
  server.setGreeting({{false, bytesOf("scene 2")}, {true, bytesOf("geometry 2")}});
  server.text(bytesOf("to all"));
  for (SocketClient* viewer : {&first, &second})
    for (const char* expected : {"scene 2", "geometry 2", "to all"}) EXPECT_EQ(viewer->read().data, expected);
  server.textTo(2, bytesOf("to you"));
  server.textTo(99, bytesOf("to nobody"));
  server.text(bytesOf("end"));
  EXPECT_EQ(second.read().data, "to you");
  EXPECT_EQ(second.read().data, "end");
  EXPECT_EQ(first.read().data, "end");
}

TEST(Server, PassesMessagesOnAndKeepsAcknowledgments) {
  RunningServer running;
  SocketClient viewer(running.server.port());
  viewer.send(R"({"type":"take"})");
  viewer.acknowledge(3);
  viewer.send(std::string(4096, 'x'));
  ASSERT_TRUE(running.waitForMessages(2));
  EXPECT_EQ(running.messages[0], std::make_pair(1, std::string(R"({"type":"take"})")));
  EXPECT_EQ(running.messages[1].second.size(), 4096u);
}

TEST(Server, ClosesOnMessagesThatAreNone) {
  RunningServer running;
  const unsigned short port = running.server.port();
  SocketClient large(port), binary(port), broken(port), unmasked(port);
  large.send(std::string(4097, 'x'));
  EXPECT_EQ(large.readClose().closeCode(), 1009);
  binary.sendFrame(2, "x");
  EXPECT_EQ(binary.readClose().closeCode(), 1003);
  broken.send("\xff\xff");
  EXPECT_EQ(broken.readClose().closeCode(), 1007);
  unmasked.connection().send("\x81\x02{}");
  EXPECT_EQ(unmasked.readClose().closeCode(), 1002);
  for (SocketClient* viewer : {&large, &binary, &broken, &unmasked}) viewer->connection().close();
  EXPECT_TRUE(running.waitFor([&] { return running.left.size() == 4; }));
  EXPECT_TRUE(running.messages.empty());
}

TEST(Server, SendsTheNewestFrameToAViewerThatHasStalled) {
  RunningServer running;
  Server& server = running.server;
  SocketClient stalled(server.port(), "", "/ws", 8192), lively(server.port());
  ASSERT_TRUE(running.waitForViewers(2));
  stalled.read();
  lively.read();
  // large enough that the first does not fit into the buffers of the sockets
  const unsigned frames = 50;
  for (unsigned step = 1; step <= frames; ++step) {
    std::string full(1'000'000, 'x');
    full.replace(0, 4, std::to_string(1000 + step));
    server.frame(step, bytesOf(full), bytesOf(std::to_string(step) + " light"));
    EXPECT_EQ(lively.read().data.substr(0, 4), std::to_string(1000 + step));
    lively.acknowledge(step);
  }
  EXPECT_EQ(stalled.read().data.substr(0, 4), "1001");
  EXPECT_EQ(stalled.read().data.substr(0, 4), std::to_string(1000 + frames));
  EXPECT_FALSE(stalled.connection().hasData(100));
}

TEST(Server, SendsNoFrameToAViewerThatDoesNotAnswer) {
  RunningServer running;
  Server& server = running.server;
  SocketClient viewer(server.port());
  ASSERT_TRUE(running.waitForViewers(1));
  viewer.read();
  for (unsigned step = 1; step <= 3; ++step) {
    server.frame(step, bytesOf("frame"), bytesOf("light"));
    EXPECT_EQ(viewer.read().data, "frame");
  }
  for (unsigned step = 4; step <= 9; ++step) server.frame(step, bytesOf("frame " + std::to_string(step)), nullptr);
  EXPECT_FALSE(viewer.connection().hasData(100));
  viewer.acknowledge(3);
  EXPECT_EQ(viewer.read().data, "frame 9");
}

TEST(Server, CountsTheSamplesThatASlowViewerMisses) {
  RunningServer running;
  Server& server = running.server;
  SocketClient slow(server.port(), "", "/ws", 8192);
  ASSERT_TRUE(running.waitForViewers(1));
  slow.read();
  const unsigned batches = 1000, ticks = 17;
  for (unsigned i = 0; i < batches; ++i) server.samples(bytesOf(sampleBatch(i, ticks, 0, 20'000)), ticks);
  server.text(bytesOf("end"));
  unsigned expected = 0, got = 0, lost = 0;
  while (expected < batches) {
    const auto message = slow.read();
    if (message.kind == 1) continue;
    const unsigned number = fieldOf(message.data, 4), missed = fieldOf(message.data, 16);
    ASSERT_GE(number, expected);
    EXPECT_EQ(missed, (number - expected) * ticks);
    expected = number + 1;
    ++got;
    lost += missed;
  }
  EXPECT_EQ(got * ticks + lost, batches * ticks);
  EXPECT_GE(got, 200u);          // 4 MiB
  EXPECT_LT(got, batches / 2u);  // and what the kernel keeps
}

TEST(Server, ClosesAViewerThatLetsTextsPileUp) {
  RunningServer running;
  SocketClient slow(running.server.port(), "", "/ws", 8192);
  ASSERT_TRUE(running.waitForViewers(1));
  for (int i = 0; i < 100; ++i) running.server.textTo(1, bytesOf(std::string(100'000, 'x')));
  EXPECT_TRUE(running.waitForViewers(0));
  EXPECT_EQ(slow.readClose().closeCode(), 1008);
}

TEST(Server, TellsTheSeventeenthViewerThatThereAreTooMany) {
  RunningServer running;
  std::vector<std::unique_ptr<SocketClient>> viewers;
  for (int i = 0; i < 16; ++i) {
    viewers.push_back(std::make_unique<SocketClient>(running.server.port()));
    EXPECT_EQ(viewers.back()->read().kind, 1);
  }
  SocketClient one_more(running.server.port());
  const auto close = one_more.read();
  EXPECT_EQ(close.closeCode(), 1013);
  EXPECT_EQ(close.data.substr(2), "16 viewers are here already");
  EXPECT_EQ(running.server.viewers(), 16);
  viewers[3]->sendFrame(8, "");
  EXPECT_EQ(viewers[3]->read().kind, 8);
  viewers[3]->connection().close();
  ASSERT_TRUE(running.waitForViewers(15));
  EXPECT_EQ(SocketClient(running.server.port()).read().kind, 1);
}

TEST(Server, SurvivesAHundredViewersThatComeAndGo) {
  RunningServer running;
  Server& server = running.server;
  server.setGreeting({{false, bytesOf("scene")}, {true, bytesOf(std::string(300'000, 'g'))}});
  for (unsigned i = 0; i < 100; ++i) {
    SocketClient viewer(server.port());
    ASSERT_TRUE(viewer.open());
    server.frame(i, bytesOf("frame"), nullptr);
    if (i % 3 == 0) viewer.read();
    if (i % 3 == 1) viewer.sendFrame(8, "");
  }
  EXPECT_TRUE(running.waitFor([&] { return running.left.size() == 100; }));
  EXPECT_EQ(running.joined.size(), 100u);
  EXPECT_EQ(server.viewers(), 0);
}

TEST(Server, BoundsConnectionsThatAreNoViewers) {
  RunningServer running;
  std::vector<std::unique_ptr<TcpClient>> idle;
  for (int i = 0; i < 80; ++i) idle.push_back(std::make_unique<TcpClient>(running.server.port()));
  TcpClient one_more(running.server.port());
  EXPECT_TRUE(one_more.endsNow());
  idle.clear();
  const auto begin = Clock::now();
  while (secondsSince(begin) < 10.0) {  // until it has noticed
    try {
      EXPECT_EQ(ask(running.server.port(), "GET", "/").status, 200);
      return;
    } catch (const std::runtime_error&) {
    }
  }
  FAIL() << "does not answer any more";
}

// --- the end

TEST(Server, TellsViewersThatItStops) {
  RunningServer running;
  SocketClient polite(running.server.port()), silent(running.server.port());
  TcpClient idle(running.server.port());
  ASSERT_TRUE(running.waitForViewers(2));
  running.server.text(bytesOf("last words"));
  std::thread closer([&] {
    EXPECT_EQ(polite.read().data.substr(0, 9), "{\"type\":\"");
    EXPECT_EQ(polite.read().data, "last words");
    const auto close = polite.read();
    EXPECT_EQ(close.closeCode(), 1001);
    polite.sendFrame(8, close.data);
  });
  const auto begin = Clock::now();
  running.stop();
  closer.join();
  EXPECT_LT(secondsSince(begin), 3.0);
  EXPECT_EQ(running.left.size(), 2u);
  EXPECT_TRUE(idle.endsNow());
  EXPECT_EQ(running.server.viewers(), 0);
  running.server.frame(1, bytesOf("x"), nullptr);  // nobody hears it
}

TEST(Server, StopsAtOnceWhereNobodyIsThere) {
  RunningServer running;
  EXPECT_EQ(ask(running.server.port(), "GET", "/").status, 200);
  const auto begin = Clock::now();
  running.stop();
  EXPECT_LT(secondsSince(begin), 0.5);
}

TEST(Server, StopsThoughAViewerTakesNothing) {
  RunningServer running;
  SocketClient stalled(running.server.port(), "", "/ws", 8192);
  ASSERT_TRUE(running.waitForViewers(1));
  running.server.frame(1, bytesOf(std::string(20'000'000, 'x')), nullptr);
  const auto begin = Clock::now();
  running.stop();
  EXPECT_LT(secondsSince(begin), 3.0);
  EXPECT_EQ(running.left.size(), 1u);
}

TEST(Server, StopsBeforeItRan) {
  Server server({}, {}, "{}", {});
  server.stop();
  const auto begin = Clock::now();
  server.run();
  EXPECT_LT(secondsSince(begin), 0.5);
  EXPECT_THROW(TcpClient{server.port()}, std::runtime_error);  // it does not listen any more
}

TEST(Server, StopsOnSignals) {
  for (const int signal : {SIGTERM, SIGINT}) {
    ServerOptions options;
    options.stop_on_signals = true;
    RunningServer running(options);
    SocketClient viewer(running.server.port());
    ASSERT_TRUE(running.waitForViewers(1));
    std::raise(signal);
    EXPECT_EQ(viewer.readClose().closeCode(), 1001) << signal;  // told that the server goes
    viewer.connection().close();
    ASSERT_TRUE(running.waitFor([&] { return running.left.size() == 1; })) << signal;
    running.stop();
    EXPECT_THROW(TcpClient{running.server.port()}, std::runtime_error) << signal;
  }
}

TEST(Server, TakesTheFirstSignalOnly) {
  static std::atomic<int> caught{0};
  const auto before = std::signal(SIGTERM, [](int) { ++caught; });
  {
    ServerOptions options;
    options.stop_on_signals = true;
    RunningServer running(options);
    SocketClient viewer(running.server.port());
    ASSERT_TRUE(running.waitForViewers(1));
    std::raise(SIGTERM);
    EXPECT_EQ(viewer.readClose().closeCode(), 1001);
    EXPECT_EQ(caught, 0);
    std::raise(SIGTERM);
    EXPECT_EQ(caught, 1);
  }
  std::raise(SIGTERM);
  EXPECT_EQ(caught, 2);
  std::signal(SIGTERM, before);
}

TEST(Server, LeavesSignalsAloneUnlessAsked) {
  static std::atomic<int> caught{0};
  const auto before = std::signal(SIGTERM, [](int) { ++caught; });
  RunningServer running;
  std::raise(SIGTERM);
  std::signal(SIGTERM, before);
  EXPECT_EQ(caught, 1);
  EXPECT_EQ(ask(running.server.port(), "GET", "/").status, 200);
}

TEST(Server, LetsExceptionsOfItsOwnerThrough) {
  ServerHandlers handlers;
  handlers.joined = [](int) { throw RunError("full"); };
  Server server({}, {}, "{}", std::move(handlers));
  std::thread viewer([port = server.port()] {
    try {
      SocketClient client(port);
      client.readClose();
    } catch (const std::runtime_error&) {
    }
  });
  EXPECT_THROW(server.run(), RunError);
  viewer.detach();
}

}  // namespace
}  // namespace palpate
