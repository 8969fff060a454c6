#include "page.h"

// The assembler takes the built files as they are; a compiler would need seconds for them as arrays.
#define PALPATE_PAGE_FILE(name, file)                                                                        \
  asm(".section .rodata\n"                                                                                   \
      ".global palpate_page_" #name                                                                          \
      "\n"                                                                                                   \
      "palpate_page_" #name                                                                                  \
      ":\n"                                                                                                  \
      ".incbin \"" PALPATE_PAGE_DIR "/" file                                                                 \
      "\"\n"                                                                                                 \
      ".global palpate_page_" #name                                                                          \
      "_end\n"                                                                                               \
      "palpate_page_" #name                                                                                  \
      "_end:\n"                                                                                              \
      ".byte 0\n"                                                                                            \
      ".previous\n");                                                                                        \
  extern "C" const char palpate_page_##name[];                                                               \
  extern "C" const char palpate_page_##name##_end[];                                                         \
  static std::string_view name() {                                                                           \
    return {palpate_page_##name, static_cast<std::size_t>(palpate_page_##name##_end - palpate_page_##name)}; \
  }

PALPATE_PAGE_FILE(html, "index.html")
PALPATE_PAGE_FILE(script, "app.js")
PALPATE_PAGE_FILE(style, "app.css")
PALPATE_PAGE_FILE(icon, "icon.svg")

namespace palpate {

std::vector<StaticFile> pageFiles() {
  return {{"/", "text/html; charset=utf-8", html()},
          {"/app.js", "text/javascript; charset=utf-8", script()},
          {"/app.css", "text/css; charset=utf-8", style()},
          {"/icon.svg", "image/svg+xml", icon()}};
}

}  // namespace palpate
