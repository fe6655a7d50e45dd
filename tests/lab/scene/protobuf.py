"""Reads Protobuf messages by the descriptors that travel with them, without any generated code."""

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory


def reader_of(schema, name):
    """Return the class of a message from a serialised set of file descriptors."""
    files, pool = descriptor_pb2.FileDescriptorSet.FromString(schema), descriptor_pool.DescriptorPool()
    waiting = list(files.file)
    while waiting:
        each = waiting.pop(0)
        try:
            pool.Add(each)
        except TypeError:  # what it imports is not there yet
            waiting.append(each)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(name))
