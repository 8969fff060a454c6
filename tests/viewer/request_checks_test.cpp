#include "palpate/viewer/request_checks.h"

#include <gtest/gtest.h>

namespace palpate {
namespace {

TEST(RequestChecks, TakesHostsOfTheLoopbackAndOfTheAddressListenedOn) {
  for (const char* host : {"localhost", "LocalHost:80", "127.0.0.1", "127.0.0.1:8080", "127.1.2.3:1", "[::1]:8080",
                           "[::1]", "[0:0:0:0:0:0:0:1]:8080", "[::ffff:127.0.0.1]"}) {
    EXPECT_TRUE(isAllowedHost(host, "127.0.0.1")) << host;
    EXPECT_TRUE(isAllowedHost(host, "192.168.1.7")) << host;
  }
  EXPECT_TRUE(isAllowedHost("192.168.1.7:8080", "192.168.1.7"));
  EXPECT_TRUE(isAllowedHost("[fe80:0::1]:8080", "fe80::1"));
  EXPECT_FALSE(isAllowedHost("192.168.1.8:8080", "192.168.1.7"));
  EXPECT_FALSE(isAllowedHost("192.168.1.7:8080", "127.0.0.1"));
  EXPECT_FALSE(isAllowedHost("[fe80::2]", "fe80::1"));
}

TEST(RequestChecks, TakesAnyNumericHostAndNoNameWhereItListensOnEveryAddress) {
  for (const char* listen : {"0.0.0.0", "::", "0:0:0:0:0:0:0:0"}) {
    EXPECT_TRUE(isWildcardAddress(listen));
    EXPECT_TRUE(isAllowedHost("10.1.2.3:8080", listen));
    EXPECT_TRUE(isAllowedHost("[2001:db8::1]:8080", listen));
    EXPECT_FALSE(isAllowedHost("evil.example:8080", listen));
  }
}

TEST(RequestChecks, RefusesOtherHosts) {
  for (const char* host : {"",
                           "evil.example",
                           "evil.example:8080",
                           "localhost.evil.example",
                           "127.0.0.1.evil.example",
                           "127.0.0.1:",
                           "127.0.0.1:x",
                           "127.0.0.1:123456",
                           "127.0.0.1 ",
                           "127.0.0.1/",
                           "127.0.0.1@evil",
                           "::1",
                           "[::1",
                           "[::1]x",
                           "[127.0.0.1]",
                           "[]",
                           "127.1",
                           "0x7f000001",
                           "2130706433",
                           "localhost."})
    EXPECT_FALSE(isAllowedHost(host, "127.0.0.1")) << host;
  EXPECT_FALSE(isAllowedHost(std::string_view("127.0.0.1\0.evil", 15), "127.0.0.1"));
}

TEST(RequestChecks, TellsItsOwnPageFromOthers) {
  EXPECT_TRUE(isOwnOrigin("http://127.0.0.1:8080", "127.0.0.1:8080"));
  EXPECT_TRUE(isOwnOrigin("HTTP://LocalHost:8080", "localhost:8080"));
  EXPECT_TRUE(isOwnOrigin("http://localhost", "localhost:80"));
  EXPECT_TRUE(isOwnOrigin("http://[::1]:8080", "[::1]:8080"));
  for (const char* origin :
       {"", "null", "http://", "https://127.0.0.1:8080", "http://127.0.0.1:8081", "http://127.0.0.1",
        "http://localhost:8080", "http://evil.example", "http://127.0.0.1:8080.evil.example", "http://127.0.0.1:8080/",
        "file://", "127.0.0.1:8080"})
    EXPECT_FALSE(isOwnOrigin(origin, "127.0.0.1:8080")) << origin;
  EXPECT_FALSE(isOwnOrigin("http://", ""));
}

TEST(RequestChecks, DecodesQueries) {
  EXPECT_EQ(queryValue("/surface?name=a%20b+c%2B.obj&x=1", "name"), "a b c+.obj");
  EXPECT_EQ(queryValue("/?x=1&name=", "name"), "");
  EXPECT_EQ(queryValue("/?name", "name"), "");
  EXPECT_EQ(queryValue("/?name=1&name=2", "name"), "1");
  EXPECT_EQ(queryValue("/?name=a=b?c", "name"), "a=b?c");
  EXPECT_EQ(queryValue("/?&&&name=%C3%a4", "name"), "\xc3\xa4");
  for (const char* target : {"/", "/?", "/?names=1", "/?xname=1", "/name=1", "/?name=%", "/?name=%1", "/?name=%zz"})
    EXPECT_FALSE(queryValue(target, "name")) << target;
  EXPECT_EQ(targetPath("/surface?name=/x?"), "/surface");
  EXPECT_EQ(targetPath("/"), "/");
}

TEST(RequestChecks, FindsCookies) {
  EXPECT_EQ(cookieValue("a=1; palpate-80=T ; b=2", "palpate-80"), "T");
  EXPECT_EQ(cookieValue("palpate-80=a=b", "palpate-80"), "a=b");
  EXPECT_EQ(cookieValue("palpate-80=", "palpate-80"), "");
  for (const char* header : {"", ";", "palpate-8=T", "xpalpate-80=T", "palpate-80", "a=palpate-80=T"})
    EXPECT_FALSE(cookieValue(header, "palpate-80")) << header;
}

TEST(RequestChecks, ComparesTokens) {
  EXPECT_TRUE(equalInConstantTime("secret", "secret"));
  for (const char* candidate : {"", "secre", "secrets", "secreT", "secretsecret", "Secret"})
    EXPECT_FALSE(equalInConstantTime(candidate, "secret")) << candidate;
  EXPECT_FALSE(equalInConstantTime("", ""));
  EXPECT_TRUE(isToken("aZ09-._~"));
  EXPECT_TRUE(isToken(std::string(128, 'x')));
  for (const std::string& token : {std::string(), std::string(129, 'x'), std::string("a b"), std::string("a;b"),
                                   std::string("a%b"), std::string("\xc3\xa4")})
    EXPECT_FALSE(isToken(token)) << token;
}

TEST(RequestChecks, ReducesFileNames) {
  EXPECT_EQ(plainFileName("bunny.obj"), "bunny.obj");
  EXPECT_EQ(plainFileName("../../etc/passwd"), "passwd");
  EXPECT_EQ(plainFileName("C:\\fakepath\\bunny.obj"), "bunny.obj");
  EXPECT_EQ(plainFileName("\xe5\x85\x94.obj"), "\xe5\x85\x94.obj");
  EXPECT_EQ(plainFileName(std::string(100, 'x')), std::string(100, 'x'));
  std::string hundred;
  for (int i = 0; i < 100; ++i) hundred += "\xf0\x9f\x90\x87";
  EXPECT_EQ(plainFileName(hundred), hundred);
  for (const std::string& name :
       {std::string(), std::string("."), std::string(".."), std::string("a/"), std::string("a/.."),
        std::string(101, 'x'), std::string("a\nb"), std::string("a\0b", 3), std::string("a\x7f"),
        std::string("a\x1b[2J"), std::string("\xc2\x9b"), std::string("\xff"), std::string("\xc3"),
        std::string("\xc0\xaf"), std::string("\xed\xa0\x80"), std::string("\xf4\x90\x80\x80"), hundred + "x"})
    EXPECT_FALSE(plainFileName(name)) << name;
}

}  // namespace
}  // namespace palpate
