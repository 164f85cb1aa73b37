"""A pass on threads that notes its chunks."""

from pdsurrogate.engine.passes import Pass


@Pass
def note_chunks(chunk, times, threads):
    """How often each chunk has been worked on, and by which thread."""
    times[chunk.number] += 1
    threads[chunk.number] = chunk.thread
    return chunk.number
