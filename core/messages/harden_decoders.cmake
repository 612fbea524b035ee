# cmake -P harden_decoders.cmake <generated.hpp>...: makes the decoders of lcm-gen 1.3.1 safe against hostile packets.
#   arrays   resize() takes the announced length as it comes (-1 throws, 0x7fffffff allocates gigabytes): refuse a length
#            that is negative or above the bytes left (each element takes at least one). An announced length of 0 leaves the
#            old content of a reused message: clear it.
#   strings  assign(..., length - 1) throws for a length below 1 and takes whatever stands in place of the terminator:
#            ask for exactly one NUL, at the end.
# Stops the build if a resize or a string is left that it does not know.
math(EXPR last "${CMAKE_ARGC} - 1")
foreach(i RANGE 3 ${last})
  set(file ${CMAKE_ARGV${i}})
  file(READ ${file} text)
  string(REPLACE ";" "@SEMICOLON@" text "${text}")  # a CMake list separator
  string(REGEX MATCHALL "\\.resize\\(" resizes "${text}")
  string(REGEX MATCHALL "\\.assign\\(" assigns "${text}")
  string(REGEX REPLACE "if\\((this->[A-Za-z0-9_]+)\\) {\n( *)(this->[A-Za-z0-9_]+)\\.resize\\("
    "\\3.clear()@SEMICOLON@\n    if(\\1) {\n\\2\\3.resize(" text "${text}")
  string(REGEX REPLACE "(this->[A-Za-z0-9_]+)\\.resize\\((this->[A-Za-z0-9_]+)\\)"
    "if(\\2 < 0 || \\2 > maxlen - pos) return -1@SEMICOLON@ /*bounded*/ \\1.resize(\\2)" text "${text}")
  string(REGEX REPLACE "if\\(([A-Za-z0-9_]+) > maxlen - pos\\) return -1"
    "if(\\1 < 1 || \\1 > maxlen - pos || memchr(((const char*)buf) + offset + pos, 0, (size_t)\\1) != ((const char*)buf) + offset + pos + \\1 - 1) return -1 /*bounded*/" text "${text}")
  string(REGEX MATCHALL "/\\*bounded\\*/" bounds "${text}")
  list(LENGTH resizes num_resizes)
  list(LENGTH assigns num_assigns)
  list(LENGTH bounds num_bounds)
  math(EXPR wanted "${num_resizes} + ${num_assigns}")
  if(NOT num_bounds EQUAL wanted)
    message(FATAL_ERROR "${file}: ${num_resizes} arrays and ${num_assigns} strings, but ${num_bounds} bounded: lcm-gen writes a form that harden_decoders.cmake does not know")
  endif()
  string(REPLACE "@SEMICOLON@" ";" text "${text}")
  file(WRITE ${file} "${text}")
endforeach()
