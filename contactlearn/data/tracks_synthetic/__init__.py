"""Simulated recordings of bodies that are thrown onto a floor, with the truth about every contact.

motion   flights, contacts by a law, rest: poses at any instant
camera   a tracker with noise, blur, lost and bad frames, wrong frame rate, axes and order of quaternions
"""
