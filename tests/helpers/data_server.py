"""A server on this machine whose answers break off, refuse and lie as they are told to."""

import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer


class Server:
    """Files by path, and what goes wrong with them."""

    def __init__(self):
        self.files, self.asked, self.status = {}, [], {}
        self.cut = []  # bytes after which one answer after the other ends
        self.ranges = True
        self.lies_about_range = False
        server = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self):
                server.answer(self)

            def log_message(self, *_):
                pass

        self.http = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.http.server_address[1]}"
        self.thread = threading.Thread(target=self.http.serve_forever, args=(0.01,))
        self.thread.start()

    def answer(self, handler):
        path, asked = handler.path, handler.headers.get("Range")
        self.asked.append(asked)
        if path in self.status or path not in self.files:
            handler.send_error(self.status.get(path, 404))
            return
        body, start = self.files[path], 0
        if asked and self.ranges:
            start = int(asked.removeprefix("bytes=").rstrip("-"))
            first = 0 if self.lies_about_range else start
            handler.send_response(206)
            handler.send_header("Content-Range", f"bytes {first}-{len(body) - 1}/{len(body)}")
        else:
            handler.send_response(200)
        handler.send_header("Content-Length", str(len(body) - start))
        handler.end_headers()
        handler.wfile.write(body[start:][: self.cut.pop(0) if self.cut else None])

    def close(self):
        self.http.shutdown()
        self.thread.join()
        self.http.server_close()
