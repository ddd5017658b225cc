"""The one thread that reads a camera, and the runs that steer it: a search, a depth sweep, an alarm.

It knows the contract and no camera family. What is kept on disk is the room `captures`.
"""
