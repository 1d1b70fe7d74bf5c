"""Two pseudo terminals with a wire between them: prints their names, then carries bytes until it is ended."""

import os
import select
import tty

ends = [os.openpty() for _ in range(2)]
for _, device in ends:
    tty.setraw(device)
print(*(os.ttyname(device) for _, device in ends), flush=True)
(a, _), (b, _) = ends
while True:
    for ready in select.select([a, b], [], [])[0]:
        os.write(b if ready == a else a, os.read(ready, 512))
