#pragma once

#include <boost/beast/core/basic_stream.hpp>
#include <boost/beast/core/rate_policy.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/message.hpp>

#include "palpate/viewer/server_core.h"

namespace palpate {

using Stream = boost::beast::basic_stream<boost::asio::ip::tcp, Executor, boost::beast::unlimited_rate_policy>;

/// What every answer carries, so that a page from here can load nothing from elsewhere and be shown in no other page.
void setSafetyHeaders(boost::beast::http::fields& headers);

/// Turns a connection whose upgrade request has been read, and found to be allowed, into a viewer's.
void serveViewer(ServerCore& core, Stream&& stream,
                 boost::beast::http::request<boost::beast::http::empty_body>&& upgrade);

}  // namespace palpate
